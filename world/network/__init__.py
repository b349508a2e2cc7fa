"""What the real network did to the messages of a run by the clock."""
