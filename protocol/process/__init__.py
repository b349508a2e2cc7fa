"""What every process needs: signals, its log, and where tracebacks are kept."""
