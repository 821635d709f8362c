"""The loss of differences between neighbouring pixels, against those that a gradient-domain renderer estimates.

dx = y(x + 1) - y(x) and dy = y(below) - y; [B, 6, H, W] holds dx, then dy, and the last column of dx and the last
row of dy have no neighbour in the picture and do not count.
"""

import torch

from .features import check_image

RADIUS = 2  # neighbours on each side that a weight is measured of
HEAVIEST = 10.0  # most that a difference weighs beside a colour


def differences_of(image):
    """dx and dy of [B, 3, H, W] as [B, 6, H, W]; 0 where there is no neighbour."""
    dx, dy = torch.zeros_like(image), torch.zeros_like(image)
    dx[..., :-1] = image[..., 1:] - image[..., :-1]
    dy[..., :-1, :] = image[..., 1:, :] - image[..., :-1, :]
    return torch.cat([dx, dy], dim=1)


def squared_errors(output, target):
    """||difference of mu_hat^a - G^b||^2 of both axes: [B, 2, H, W]; 0 where there is no neighbour."""
    check_image("output", output, 3)
    check_image("target", target, 6)
    batch, _, height, width = output.shape
    inside = torch.zeros(2, height, width, dtype=output.dtype)
    inside[0, :, :-1] = 1
    inside[1, :-1, :] = 1
    error = (differences_of(output) - target).square()
    return error.reshape(batch, 2, 3, height, width).sum(dim=2) * inside


def limited(relative, influence):
    """The pseudo-Huber loss of weighted squared errors e^2: 2 m^2 (sqrt(1 + e^2 / m^2) - 1)."""
    if influence == float("inf"):
        return relative
    return 2 * influence**2 * ((1 + relative / influence**2).sqrt() - 1)


def half_loss(output, noisy, weight, target, target_weight, influence=float("inf")):
    """The loss of one half, summed over pixels and channels and divided by 3 N: colours and differences."""
    colour = weight * (output - noisy).square().sum(dim=1, keepdim=True)
    difference = target_weight * squared_errors(output, target)
    pixels = output.shape[0] * output.shape[2] * output.shape[3]
    return (limited(colour, influence).sum() + limited(difference, influence).sum()) / (3 * pixels)


def weights(noisy_a, noisy_b, given_a, given_b, colour):
    """Weights of the squared errors of dx and dy, [B, 2, H, W]; `colour` [B, 1, H, W] is that of y.

    Times the variance of y over that of the difference, both over the neighbours and without the pixel itself, so
    that the weight is independent of the pixel's own noise. Outliers make it smaller: the mean of |y^a - y^b| is
    squared, that of differences is one of squares.
    """
    batch, _, height, width = noisy_a.shape
    inside = differences_of(torch.arange(height * width, dtype=torch.float64).reshape(1, 1, height, width)) != 0
    of_y = (noisy_a - noisy_b).abs().mean(dim=1, keepdim=True).expand(-1, 2, -1, -1)
    of_given = (given_a - given_b).square().reshape(batch, 2, 3, height, width).mean(dim=2)
    known = inside.to(of_y.dtype).expand(batch, -1, -1, -1)
    count = around(known).clamp_min(1)
    of_y, of_given = around(of_y * known) / count, around(of_given * known) / count
    ratio = torch.where(of_y == 0, torch.zeros_like(of_y), of_y.square() / of_given.clamp_min(1e-30))
    return known * colour * ratio.clamp_max(HEAVIEST)


def around(image):
    """Sums over the neighbours of every pixel within the picture, without the pixel: [B, C, H, W]."""
    side = 2 * RADIUS + 1
    channels = image.shape[1]
    kernel = torch.ones(channels, 1, side, side, dtype=image.dtype)
    kernel[:, :, RADIUS, RADIUS] = 0
    return torch.nn.functional.conv2d(image, kernel, padding=RADIUS, groups=channels)
