"""What every program needs, and the two small programs of the protocol's own."""
