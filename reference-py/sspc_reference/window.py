"""The sums of Eq. 10 over the window around every pixel, and their gradients.

The code follows the equation, one offset at a time: it shifts the whole image by the offset and adds that neighbour's
terms to every pixel's sums. The gradients are written out: autograd would store, or compute twice, about thirty images
for each of 361 offsets.
"""

import torch
from torch.autograd.function import once_differentiable

from .activations import BANDWIDTHS, TAU
from .features import CHANNELS

# The features' three-channel parts come channel by channel, so that squared distances of all four
# are sums of three blocks; visibility is last.
PARTS = ("albedo", "normal", "denoised", "radiance")
ORDER = [CHANNELS[part].start + k for k in range(3) for part in PARTS] + [CHANNELS["visibility"].start]
ALBEDO, NORMAL, DENOISED, RADIANCE = (slice(first, 12, 4) for first in range(4))
LAST = slice(12, 13)
# Bandwidths in the order of the distances.
DISTANCES = [BANDWIDTHS[f"gamma_{part}"] for part in (*PARTS, "visibility")]
# Distances of colours enter by their logarithm.
COLOURS = slice(2, 4)


def window_sums(padded, parameters, radius):
    """The sums over the window, differentiable with respect to the parameters (features are data).

    From features [B, 13, H + 2 radius, W + 2 radius] and activated parameters [B, 15 or 16, H, W]; the result holds
    by name the sums of w [B, 1, H, W] and of w y_i, w (z_c - z_i), w (rho_c - rho_i), w (n_c - n_i) [B, 3, H, W].
    """
    bandwidths, centre = parameters[:, DISTANCES], parameters[:, TAU : TAU + 1]
    sums = WindowSums.apply(padded[:, ORDER], bandwidths, centre, radius)
    return {
        "weight": sums[:, LAST],
        "radiance": sums[:, RADIANCE],
        "denoised": sums[:, DENOISED],
        "albedo": sums[:, ALBEDO],
        "normal": sums[:, NORMAL],
    }


class WindowSums(torch.autograd.Function):
    """S = sum over i of w_i u_i, u_i = (rho_c - rho_i, n_c - n_i, z_c - z_i, y_i, 1)."""

    @staticmethod
    def forward(context, padded, bandwidths, centre, radius):
        """Padded features in ORDER, bandwidths [B, 5, H, W], tau [B, 1, H, W] -> S [B, 13, H, W]."""
        context.save_for_backward(padded, bandwidths, centre)
        context.radius = radius
        sums = torch.zeros_like(inner(padded, radius))
        for _, u, _, weight in offsets(padded, bandwidths, centre, radius):
            sums.addcmul_(weight, u)
        return sums

    @staticmethod
    @once_differentiable
    def backward(context, upstream):
        """With w_i = exp(-sum_k gamma_k d_ki) and w_c = tau, from dL/dS:

        dL/dw_i = dL/dS . u_i,  dL/dgamma_k = -sum_i dL/dw_i w_i d_ki,  dL/dtau = dL/dw_c.
        """
        padded, bandwidths, centre = context.saved_tensors
        if context.needs_input_grad[0]:
            raise ValueError("features: there is no gradient with respect to them")
        to_bandwidths = torch.zeros_like(bandwidths)
        for offset, u, distances, weight in offsets(padded, bandwidths, centre, context.radius):
            to_weight = u.mul_(upstream).sum(dim=1, keepdim=True)
            if offset == (0, 0):
                to_centre = to_weight  # d_kc = 0: independent of the bandwidths
            else:
                to_bandwidths.addcmul_(to_weight.mul_(weight), distances, value=-1)
        return None, to_bandwidths, to_centre, None


def offsets(padded, bandwidths, centre, radius):
    """Yields every offset (dy, dx) of the window, u [B, 13, H, W], distances d [B, 5, H, W], weight w [B, 1, H, W].

    The next offset overwrites the same memory: allocating anew would take most of the time.
    """
    features = inner(padded, radius).contiguous()
    height, width = features.shape[2:]
    u, distances = torch.empty_like(features), torch.empty_like(bandwidths)
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            top, left = radius + dy, radius + dx
            neighbour = padded[:, :, top : top + height, left : left + width]
            torch.sub(features, neighbour, out=u)
            if (dy, dx) == (0, 0):
                distances.zero_()
                weight = centre
            else:
                distances_of(u, out=distances)
                weight = (bandwidths * distances).sum(dim=1, keepdim=True).neg_().exp_()
            u[:, RADIANCE] = neighbour[:, RADIANCE]
            u[:, LAST] = 1
            yield (dy, dx), u, distances, weight


def distances_of(difference, out):
    """d_k of Eq. 11 from differences [B, 13, H, W] in ORDER; to `out` [B, 5, H, W].

    |rho_c - rho_i|^2, |n_c - n_i|^2, log(1 + |z_c - z_i|^2), log(1 + |y_c - y_i|^2), (v_c - v_i)^2.
    """
    four, visibility = out[:, :4], out[:, 4:]
    torch.mul(difference[:, :4], difference[:, :4], out=four)
    for k in (4, 8):
        four.addcmul_(difference[:, k : k + 4], difference[:, k : k + 4])
    torch.mul(difference[:, LAST], difference[:, LAST], out=visibility)
    out[:, COLOURS].log1p_()


def inner(padded, radius):
    """Removes a border of `radius` pixels from [B, C, H + 2 radius, W + 2 radius]."""
    height, width = padded.shape[2] - 2 * radius, padded.shape[3] - 2 * radius
    return padded[:, :, radius : radius + height, radius : radius + width]
