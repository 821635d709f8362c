"""bench/convergence: error against samples per pixel, against training steps, and at equal time."""
