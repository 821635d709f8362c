"""The parity cases: inputs and what float64 PyTorch makes of them, for other implementations to meet."""
