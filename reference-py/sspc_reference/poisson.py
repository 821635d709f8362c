"""Screened-Poisson reconstruction of y and its differences (Lehtinen et al. 2013, Kettunen et al. 2015).

Its picture x minimises sum alpha^2 |x - y|^p + |dx of x - dx|^p + |dy of x - dy|^p with p = 2 (L2, unbiased) or 1
(L1, which outliers disturb less), alpha = 0.2. L1 is solved by iteratively reweighted least squares.
"""

import numpy as np

ALPHA = 0.2
STEPS = 50  # of conjugate gradients, per reweighting
REWEIGHTINGS = 20
FLOOR = 0.05  # of an error, as a share of the first mean error, falling by half with every reweighting


def reconstruct(noisy, dx, dy, norm="L1", alpha=ALPHA):
    """The picture (height, width, 3); dx = y(x + 1) - y(x), dy = y(below) - y, of the same shape."""
    given = np.stack([dx, dy]).astype(np.float64)
    given[0, :, -1], given[1, -1] = 0, 0
    noisy = noisy.astype(np.float64)
    ones = np.ones((3, *noisy.shape[:2], 1))
    picture = solve(noisy, noisy, given, alpha**2 * ones[0], ones[1:])
    if norm == "L2":
        return picture
    floor = FLOOR * np.abs(picture - noisy).mean()
    for _ in range(REWEIGHTINGS):
        errors = np.concatenate([[alpha * (picture - noisy)], differences(picture) - given])
        weight = 1 / np.maximum(np.sqrt((errors**2).sum(-1, keepdims=True)), floor)
        floor = max(0.5 * floor, 1e-4 * np.abs(noisy).mean())
        picture = solve(picture, noisy, given, alpha**2 * weight[0], weight[1:])
    return picture


def solve(start, noisy, given, own, of_differences):
    """Conjugate gradients from `start` on weighted least squares, preconditioned by the diagonal."""

    def normal(x):
        return own * x + transposed(of_differences * differences(x))

    diagonal = own + degree(of_differences)
    x = start.copy()
    residual = own * noisy + transposed(of_differences * given) - normal(x)
    direction = residual / diagonal
    size = (residual * direction).sum()
    for _ in range(STEPS):
        if size <= 0:
            break
        image = normal(direction)
        step = size / (direction * image).sum()
        x += step * direction
        residual -= step * image
        scaled = residual / diagonal
        size, before = (residual * scaled).sum(), size
        direction = scaled + size / before * direction
    return x


def differences(x):
    """dx and dy, 0 where there is no neighbour: (2, height, width, 3)."""
    out = np.zeros((2, *x.shape))
    out[0, :, :-1] = x[:, 1:] - x[:, :-1]
    out[1, :-1] = x[1:] - x[:-1]
    return out


def transposed(g):
    """The adjoint of `differences`."""
    out = np.zeros(g.shape[1:])
    out[:, :-1] -= g[0, :, :-1]
    out[:, 1:] += g[0, :, :-1]
    out[:-1] -= g[1, :-1]
    out[1:] += g[1, :-1]
    return out


def degree(weight):
    """Sum of the weights of the differences that a pixel is in: the diagonal of the normal equations."""
    out = np.zeros(weight.shape[1:])
    out[:, :-1] += weight[0, :, :-1]
    out[:, 1:] += weight[0, :, :-1]
    out[:-1] += weight[1, :-1]
    out[1:] += weight[1, :-1]
    return out
