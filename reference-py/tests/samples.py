"""Random images for the tests: float64, the ranges of real frames."""

import torch
from sspc_reference import features


def generator(seed):
    return torch.Generator().manual_seed(seed)


def uniform(seed, *shape, low=0.0, high=1.0):
    values = torch.rand(*shape, generator=generator(seed), dtype=torch.float64)
    return low + (high - low) * values


def random_features(seed, height, width, batch=1):
    return features.assemble(
        radiance=uniform(seed, batch, 3, height, width, high=2.0),
        denoised=uniform(seed + 1, batch, 3, height, width, high=2.0),
        albedo=uniform(seed + 2, batch, 3, height, width),
        visibility=uniform(seed + 3, batch, 1, height, width),
        normal=uniform(seed + 4, batch, 3, height, width, low=-1.0),
    )


def random_raw(seed, height, width, outputs=15, batch=1):
    return torch.randn(batch, outputs, height, width, generator=generator(seed), dtype=torch.float64)
