"""One tick of a robot, as a pure function, and the message handling around it without I/O."""
