"""The temporal mean m of a shot's frame: neighbours warped along their motion, weighted by features and light.

Images are [1, C, H, W]; a field [1, 2, H, W] says how many pixels to the right and down a pixel lies in the neighbour.
"""

import torch

STRENGTH = 0.3
ALBEDO_WEIGHT = 8
NORMAL_WEIGHT = 2
FLICKER_RADIUS = 4
FLICKER = 4
OTHER = 0.5
FADE = 0.3


def bilinear_weights(f):
    """Weights of the taps at X0 and X0 + 1."""
    return torch.stack([1 - f, f])


def cubic_weights(f):
    """Catmull-Rom: weights of the taps at X0 - 1 .. X0 + 2."""
    return torch.stack([-f + 2 * f**2 - f**3, 2 - 5 * f**2 + 3 * f**3, f + 4 * f**2 - 3 * f**3, -(f**2) + f**3]) / 2


def places(field):
    """Columns and rows where the pixels lie, and whether that is inside of the picture."""
    height, width = field.shape[-2:]
    x = torch.arange(width, dtype=field.dtype) + field[0, 0]
    y = torch.arange(height, dtype=field.dtype)[:, None] + field[0, 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return x, y, inside


def warp(image, field, weights):
    """`image` along `field`, and whether it is inside; taps beyond the border repeat the edge pixel."""
    height, width = image.shape[-2:]
    x, y, inside = places(field)
    x, y = x.clamp(0, width - 1), y.clamp(0, height - 1)
    left, top = x.floor(), y.floor()
    across, down = weights(x - left), weights(y - top)
    first = 1 - len(across) // 2
    warped = torch.zeros_like(image)
    for j, row_weight in enumerate(down):
        rows = (top + first + j).clamp(0, height - 1).long()
        for i, column_weight in enumerate(across):
            columns = (left + first + i).clamp(0, width - 1).long()
            warped = warped + row_weight * column_weight * image[:, :, rows, columns]
    return warped, inside


def validity(features, neighbour, field):
    """v [1, 1, H, W] of `features` and the neighbour's, dictionaries with albedo and normal."""
    distance = 0
    for role, weight in (("albedo", ALBEDO_WEIGHT), ("normal", NORMAL_WEIGHT)):
        if role in features and role in neighbour:
            warped, _ = warp(neighbour[role], field, bilinear_weights)
            distance = distance + weight * ((features[role] - warped) ** 2).sum(1, keepdim=True)
    _, _, inside = places(field)
    return inside * torch.exp(-STRENGTH * torch.as_tensor(distance, dtype=field.dtype))


def box_mean(image, radius):
    """Means of (2 radius + 1)² pixels, those outside of the picture left out."""
    side = 2 * radius + 1
    return torch.nn.functional.avg_pool2d(image, side, 1, radius, count_include_pad=False)


def brightness(denoised):
    """ℓ [1, 1, H, W] of a half's denoised picture."""
    return box_mean(denoised.mean(1, keepdim=True), 1)


def same_light(denoised, neighbour, flicker_of, field):
    """What of v stays [1, 1, H, W]: `denoised`, `neighbour` of one half, `flicker_of` both of the neighbour."""
    a, b = (brightness(half) for half in flicker_of)
    own, (other, _) = brightness(denoised), warp(brightness(neighbour), field, bilinear_weights)
    flicker, _ = warp(box_mean((a - b) ** 2, FLICKER_RADIUS), field, bilinear_weights)
    apart = ((own - other) ** 2 - FLICKER * flicker).clamp(min=0).sqrt()
    brighter = torch.maximum(own, other)
    return torch.where(apart > 0, ((OTHER - apart / brighter) / FADE).clamp(0, 1), 1.0)


def temporal_mean(denoised, neighbours):
    """m of z and of the neighbours' (z, field, validity)."""
    total, weight = denoised, 1
    for other, field, valid in neighbours:
        warped, _ = warp(other, field, cubic_weights)
        total, weight = total + valid * warped, weight + valid
    return total / weight
