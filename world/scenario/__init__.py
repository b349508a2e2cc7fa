"""The scenario: its model, where it is read from, and what is refused."""
