"""Time and memory against the size of the frame; the command is bench/scale."""
