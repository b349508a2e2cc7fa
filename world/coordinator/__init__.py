"""One run, round by round, without I/O: in lock-step and by the clock."""
