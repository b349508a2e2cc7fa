"""What a real network did in recorded runs: tables and traces; certificates for secure networks."""
