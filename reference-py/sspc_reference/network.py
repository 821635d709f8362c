"""The network: nine 3x3 convolutions from 13 features to the raw outputs o."""

import math

import torch
from torch import nn

from . import activations
from .features import COUNT, check_image

HIDDEN_LAYERS = 8
HIDDEN_CHANNELS = 16


class Network(nn.Module):
    """Eight 3x3 convolutions of 16 channels with ReLU, one 3x3 convolution to P channels.

    Zero 'same' padding, so a pixel sees features up to 9 pixels away. 20 303 weights for P = 15.
    """

    def __init__(self, outputs=activations.PAPER_OUTPUTS):
        super().__init__()
        widths = [COUNT] + [HIDDEN_CHANNELS] * HIDDEN_LAYERS + [outputs]
        self.layers = nn.ModuleList(
            nn.Conv2d(inputs, outputs, kernel_size=3, padding=1) for inputs, outputs in zip(widths[:-1], widths[1:])
        )

    def forward(self, features):
        """Features [B, 13, H, W] -> raw outputs [B, P, H, W]."""
        return self.stages(features)[-1]

    def stages(self, features):
        """The output of every layer in order, after its ReLU: eight [B, 16, H, W], then [B, P, H, W]."""
        check_image("features", features, COUNT)
        stages = [features]
        for layer in self.layers[:-1]:
            stages.append(torch.relu(layer(stages[-1])))
        stages.append(self.layers[-1](stages[-1]))
        return stages[1:]

    def flat(self):
        """All weights in one vector: for each layer its weight [out][in][3][3], then its bias [out]."""
        return torch.cat([values.detach().reshape(-1) for values in self.parameters()])

    def flat_gradient(self):
        """The gradient of every weight, in the order of `flat`."""
        return torch.cat([values.grad.reshape(-1) for values in self.parameters()])

    def load_flat(self, vector):
        """Takes weights in the order of `flat`."""
        count = sum(values.numel() for values in self.parameters())
        if vector.shape != (count,):
            raise ValueError(f"weights: expected [{count}], found {list(vector.shape)}")
        if not torch.isfinite(vector).all():
            raise ValueError("weights: NaN or infinite values")
        with torch.no_grad():
            start = 0
            for values in self.parameters():
                values.copy_(vector[start : start + values.numel()].reshape(values.shape))
                start += values.numel()


def uniform_start(network, generator):
    """Glorot's uniform start with zero biases in every layer: the start of the paper's preset."""
    with torch.no_grad():
        for layer in network.layers:
            fan_in, fan_out = layer.weight.shape[1] * 9, layer.weight.shape[0] * 9
            bound = math.sqrt(6 / (fan_in + fan_out))
            layer.weight.uniform_(-bound, bound, generator=generator)
            layer.bias.zero_()


def near_denoised_start(network, generator):
    """Starts with g_c near z + smoothed (y - z), which is better than z in most frames untrained.

    The uniform start, the last layer's weights at a tenth, and its biases such that
    beta^z = 0.9, beta^rho = beta^n = 0, gamma = (rho 30, n 4, v 1, y 0.5, z 5), tau = 1, s = 1/2.
    """
    uniform_start(network, generator)
    last = network.layers[-1]
    biases = (
        [activations.raw_slope(0.9)] * 3
        + [0.0] * 6
        + [activations.raw_bandwidth(gamma) for gamma in (30, 4, 1, 0.5, 5)]
        + [activations.raw_centre(1.0)]
        + [activations.raw_gate(0.5)]
    )
    with torch.no_grad():
        last.weight *= 0.1
        last.bias.copy_(torch.tensor(biases[: last.bias.numel()], dtype=last.bias.dtype))
