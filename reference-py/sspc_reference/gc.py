"""The post-correction function g_c (paper Eq. 10) and its cross-bilateral weights (Eq. 11).

Both sums run over the window around pixel c, and the code does the same, one offset at a time:
for every offset it shifts the whole image and adds that neighbour's share to every pixel's sums.
Autograd then gives the gradients.
"""

import torch
from torch.utils.checkpoint import checkpoint

from .activations import BANDWIDTHS, GATE, GATED_OUTPUTS, PAPER_OUTPUTS, SLOPES, TAU
from .features import CHANNELS, COUNT, check_image, part

RADIUS = 9  # a 19x19 window
WEIGHT_FLOOR = 1e-5  # the sum of weights is at least this

# The sums that g_c is made of: w, w y_i, w (z_c - z_i), w (rho_c - rho_i), w (n_c - n_i).
SUM_CHANNELS = 1 + 4 * 3


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


def squared_distance(centre, neighbour):
    """|centre - neighbour|^2 per pixel: [B, C, H, W] twice -> [B, 1, H, W]."""
    return (centre - neighbour).square().sum(dim=1, keepdim=True)


def neighbour_weight(centre, neighbour, parameters):
    """w_i of Eq. 11 for one offset i != c; [B, 13, H, W] twice -> [B, 1, H, W]."""

    def gamma(name):
        channel = BANDWIDTHS[name]
        return parameters[:, channel : channel + 1]

    def distance(name):
        return squared_distance(part(centre, name), part(neighbour, name))

    exponent = (
        gamma("gamma_albedo") * distance("albedo")
        + gamma("gamma_normal") * distance("normal")
        + gamma("gamma_visibility") * distance("visibility")
        + gamma("gamma_radiance") * torch.log1p(distance("radiance"))
        + gamma("gamma_denoised") * torch.log1p(distance("denoised"))
    )
    return torch.exp(-exponent)


def offset_sums(features, padded, parameters, radius, dy, dx):
    """One offset's share of the sums, [B, 13, H, W]."""
    height, width = features.shape[2:]
    top, left = radius + dy, radius + dx
    neighbour = padded[:, :, top : top + height, left : left + width]
    if dy == 0 and dx == 0:
        weight = parameters[:, TAU : TAU + 1]  # w_c = tau_c
    else:
        weight = neighbour_weight(features, neighbour, parameters)
    difference = features - neighbour
    return weight * torch.cat(
        [
            torch.ones_like(weight),
            part(neighbour, "radiance"),
            part(difference, "denoised"),
            part(difference, "albedo"),
            part(difference, "normal"),
        ],
        dim=1,
    )


def row_sums(features, padded, parameters, radius, dy):
    """The sums over one row of the window, [B, 13, H, W]."""
    return sum(
        offset_sums(features, padded, parameters, radius, dy, dx)
        for dx in range(-radius, radius + 1)
    )


def correct(features, parameters, radius=RADIUS):
    """g_c of every pixel: features [B, 13, H, W], activated parameters [B, 15 or 16, H, W] -> [B, 3, H, W]."""
    check_image("features", features, COUNT)
    return correct_padded(mirror_pad(features, radius), parameters, radius)


def correct_padded(padded, parameters, radius=RADIUS):
    """g_c of a rectangle whose surroundings are known: features [B, 13, H + 2 radius, W + 2 radius].

    The slopes do not depend on i, so they leave the sum of Eq. 10:
        g_c = ( S_y + beta^z o S_dz + beta^rho o S_drho + beta^n o S_dn ) / max(S_w, 1e-5).
    The gate (channel 15), where there is one, plays no part here; see `gated`.
    """
    check_image("padded features", padded, COUNT)
    features = inner(padded, radius)
    check_parameters(parameters, features)
    sums = features.new_zeros(features.shape[0], SUM_CHANNELS, *features.shape[2:])
    for dy in range(-radius, radius + 1):
        # One row's intermediate images are recomputed in the backward pass instead of kept:
        # all 361 offsets of a batch of patches would not fit into memory.
        sums = sums + checkpoint(
            row_sums, features, padded, parameters, radius, dy, use_reentrant=False
        )
    weight, radiance, denoised, albedo, normal = sums.split([1, 3, 3, 3, 3], dim=1)
    corrected = (
        radiance
        + parameters[:, SLOPES["beta_denoised"]] * denoised
        + parameters[:, SLOPES["beta_albedo"]] * albedo
        + parameters[:, SLOPES["beta_normal"]] * normal
    )
    return corrected / weight.clamp_min(WEIGHT_FLOOR)


def inner(padded, radius):
    """Takes a border of `radius` pixels off [B, C, H + 2 radius, W + 2 radius]."""
    height, width = padded.shape[2] - 2 * radius, padded.shape[3] - 2 * radius
    return padded[:, :, radius : radius + height, radius : radius + width]


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
            f"parameters: expected the features' batch and size {list(features.shape)}, "
            f"found {list(parameters.shape)}"
        )
