"""From the network's raw outputs o to the parameters of g_c."""

import math

import torch

# Channels of the raw outputs and of the activated parameters.
SLOPES = {"beta_denoised": slice(0, 3), "beta_albedo": slice(3, 6), "beta_normal": slice(6, 9)}
BANDWIDTHS = {"gamma_albedo": 9, "gamma_normal": 10, "gamma_visibility": 11, "gamma_radiance": 12, "gamma_denoised": 13}
TAU = 14
GATE = 15

PAPER_OUTPUTS = 15
GATED_OUTPUTS = 16

GAMMA_FLOOR = 1e-4  # gamma = 1 / (softplus^2 + this): at most 1e4
TAU_FLOOR = 1e-4  # tau = softplus + this: always above 0


def softplus(x):
    """log(1 + e^x), exact for large |x| (PyTorch's own returns x above 20)."""
    return torch.logaddexp(x, torch.zeros_like(x))


def activate(raw):
    """Raw outputs [B, P, H, W] -> parameters of the same shape, P = 15 or 16.

    beta = tanh(o), gamma = 1 / (softplus(o)^2 + 1e-4), tau = softplus(o) + 1e-4; the gated form's
    channel 15 is s = 1 / (1 + e^-o).
    """
    if raw.dim() != 4 or raw.shape[1] not in (PAPER_OUTPUTS, GATED_OUTPUTS):
        raise ValueError(f"raw outputs: expected [B, 15 or 16, H, W], found {list(raw.shape)}")
    beta = torch.tanh(raw[:, 0:9])
    gamma = 1 / (softplus(raw[:, 9:14]).square() + GAMMA_FLOOR)
    tau = softplus(raw[:, TAU : TAU + 1]) + TAU_FLOOR
    gate = torch.sigmoid(raw[:, GATE:])  # no channel at all in the paper's form
    return torch.cat([beta, gamma, tau, gate], dim=1)


def raw_slope(beta):
    """The raw output that activates to the slope `beta`, |beta| < 1."""
    return math.atanh(beta)


def raw_bandwidth(gamma):
    """The raw output that activates to the bandwidth `gamma`, 0 < gamma < 1e4."""
    return raw_softplus(math.sqrt(1 / gamma - GAMMA_FLOOR))


def raw_centre(tau):
    """The raw output that activates to the centre weight `tau` > 1e-4."""
    return raw_softplus(tau - TAU_FLOOR)


def raw_gate(s):
    """The raw output that activates to the gate `s`, 0 < s < 1."""
    return math.log(s / (1 - s))


def raw_softplus(value):
    """Inverse of softplus: log(e^value - 1), value > 0."""
    return value + math.log(-math.expm1(-value))
