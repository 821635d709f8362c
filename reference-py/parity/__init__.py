"""The parity cases: inputs and the float64 results of PyTorch, for other implementations to match."""
