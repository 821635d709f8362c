"""The post-correction function g_c (paper Eq. 10) and its cross-bilateral weights (Eq. 11).

Both sums run over the window around pixel c; `window.py` has them.
"""

import torch

from .activations import GATE, GATED_OUTPUTS, PAPER_OUTPUTS, SLOPES
from .features import CHANNELS, COUNT, check_image
from .window import inner, window_sums

RADIUS = 9  # a 19x19 window
WEIGHT_FLOOR = 1e-5  # the sum of weights is at least this


def mirrored_indices(length, radius):
    """Indices -radius .. length + radius - 1 folded into the image, the edge pixel repeated.

    Images smaller than the window are folded as often as needed: -1 -> 0, -2 -> 1, ..., with
    period 2 * length.
    """
    index = torch.arange(-radius, length + radius) % (2 * length)
    return torch.where(index < length, index, 2 * length - 1 - index)


def mirror_pad(image, radius):
    """[B, C, H, W] -> [B, C, H + 2 radius, W + 2 radius]."""
    rows = mirrored_indices(image.shape[2], radius)
    columns = mirrored_indices(image.shape[3], radius)
    return image[:, :, rows][:, :, :, columns]


def correct(features, parameters, radius=RADIUS):
    """g_c of every pixel: features [B, 13, H, W], activated parameters [B, 15 or 16, H, W] -> [B, 3, H, W]."""
    check_image("features", features, COUNT)
    return correct_padded(mirror_pad(features, radius), parameters, radius)


def correct_padded(padded, parameters, radius=RADIUS):
    """g_c of a rectangle whose surroundings are known: features [B, 13, H + 2 radius, W + 2 radius].

    The slopes do not depend on i, so they leave the sum of Eq. 10:
        g_c = ( S_y + beta^z o S_dz + beta^rho o S_drho + beta^n o S_dn ) / max(S_w, 1e-5).
    The gate (channel 15), if any, is not applied here; see `gated`.
    """
    check_image("padded features", padded, COUNT)
    features = inner(padded, radius)
    check_parameters(parameters, features)
    sums = window_sums(padded, parameters, radius)
    corrected = (
        sums["radiance"]
        + parameters[:, SLOPES["beta_denoised"]] * sums["denoised"]
        + parameters[:, SLOPES["beta_albedo"]] * sums["albedo"]
        + parameters[:, SLOPES["beta_normal"]] * sums["normal"]
    )
    return corrected / sums["weight"].clamp_min(WEIGHT_FLOOR)


def combine(features, parameters, radius=RADIUS):
    """f_c of Deep Combiner (Back et al. 2020), the ablation: g_c with beta^z = 1, beta^rho = beta^n = 0."""
    slopes = torch.zeros_like(parameters[:, 0:9])
    slopes[:, SLOPES["beta_denoised"]] = 1
    return correct(features, torch.cat([slopes, parameters[:, 9:]], dim=1), radius)


def gated(features, parameters, radius=RADIUS):
    """mu_hat of every pixel: features [B, 13, H, W], activated parameters [B, 15 or 16, H, W] -> [B, 3, H, W].

    mu_hat_c = z_c + s_c (g_c - z_c); the paper's form has no gate, and mu_hat is g_c itself.
    """
    check_image("features", features, COUNT)
    return gated_padded(mirror_pad(features, radius), parameters, radius)


def gated_padded(padded, parameters, radius=RADIUS):
    """As `gated`, of a rectangle whose surroundings are known; see `correct_padded`."""
    corrected = correct_padded(padded, parameters, radius)
    if parameters.shape[1] == PAPER_OUTPUTS:
        return corrected
    denoised = inner(padded, radius)[:, CHANNELS["denoised"]]
    return denoised + parameters[:, GATE : GATE + 1] * (corrected - denoised)


def check_parameters(parameters, features):
    """Raises unless the parameters are [B, 15 or 16, H, W] of the features' size, and finite."""
    if parameters.dim() != 4 or parameters.shape[1] not in (PAPER_OUTPUTS, GATED_OUTPUTS):
        raise ValueError(f"parameters: expected [B, 15 or 16, H, W], found {list(parameters.shape)}")
    check_image("parameters", parameters, parameters.shape[1])
    if parameters.shape[2:] != features.shape[2:] or parameters.shape[0] != features.shape[0]:
        raise ValueError(
            f"parameters: expected the features' batch and size {list(features.shape)}, found {list(parameters.shape)}"
        )
