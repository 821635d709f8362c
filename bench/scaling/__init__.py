"""Time and memory against the size of the frame: the command bench/scale."""
