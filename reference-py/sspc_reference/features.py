"""The network's input: 13 channels per pixel, in one fixed order."""

import torch

CHANNELS = {
    "radiance": slice(0, 3),  # y, linear RGB, >= 0
    "albedo": slice(3, 6),  # rho, 0..1
    "visibility": slice(6, 7),  # v, 0..1
    "normal": slice(7, 10),  # n, -1..1
    "denoised": slice(10, 13),  # z, as y
}
COUNT = 13


class BadInput(ValueError):
    """An image that the method cannot take; the text names role, expected and found."""


def check_image(name, image, channels):
    """Raises BadInput unless `image` is [B, channels, H, W], not empty, and finite."""
    if image.dim() != 4 or image.shape[1] != channels or 0 in image.shape:
        raise BadInput(f"{name}: expected [B, {channels}, H, W], found {list(image.shape)}")
    missing = int((~torch.isfinite(image)).sum())
    if missing:
        first = (~torch.isfinite(image)).nonzero()[0].tolist()
        raise BadInput(
            f"{name}: {missing} of {image.numel()} values are NaN or infinite, the first at [b, c, y, x] = {first}"
        )


def assemble(radiance, denoised, albedo=None, visibility=None, normal=None):
    """Stacks one buffer's images into features [B, 13, H, W].

    Denoised colours are clamped at 0, noisy ones at -10: their mean would be too bright else. A feature that the
    renderer did not write is a plane of zeros: its differences vanish, so neither the weights of Eq. 11 nor
    the slopes of Eq. 10 see it.
    """
    check_image("radiance", radiance, 3)
    batch, _, height, width = radiance.shape
    planes = {
        "radiance": radiance.clamp_min(-10),
        "albedo": albedo,
        "visibility": visibility,
        "normal": normal,
        "denoised": denoised.clamp_min(0),
    }
    stack = []
    for name, where in CHANNELS.items():
        channels = where.stop - where.start
        plane = planes[name]
        if plane is None:
            plane = radiance.new_zeros(batch, channels, height, width)
        check_image(name, plane, channels)
        if plane.shape[2:] != radiance.shape[2:]:
            raise BadInput(
                f"{name}: expected {height}x{width} as the radiance, found {plane.shape[2]}x{plane.shape[3]}"
            )
        stack.append(plane)
    return torch.cat(stack, dim=1)


def part(features, name):
    """One named part of [B, 13, H, W] features, as a view."""
    return features[:, CHANNELS[name]]
