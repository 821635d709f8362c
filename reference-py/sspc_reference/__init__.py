"""Self-supervised post-correction of Monte Carlo renders, in PyTorch.

The modules follow the data: read -> features -> network -> activations -> gc -> loss -> fit ->
evaluate. Each is written from the paper's equations (J. Back, B.-S. Hua, T. Hachisuka, B. Moon,
"Self-Supervised Post-Correction for Monte Carlo Denoising", SIGGRAPH 2022) for a reader who wants
to learn the method; none is written for speed.

Tensors are [B, C, H, W], rows from top to bottom. Everything runs in the precision of its inputs:
float64 to check other implementations, float32 to fit frames.
"""
