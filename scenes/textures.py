"""Procedural textures: arrays of shape (height, width, 3), linear, 0..1, repeating at their borders."""

import numpy as np


def coordinates(size):
    """u and v of every texel's centre, in 0..1, shape (size, size)."""
    line = (np.arange(size) + 0.5) / size
    return np.meshgrid(line, line)


def noise(size, cells, seed, octaves=4):
    """Fractal value noise of zero mean and a range of about -1..1, repeating; `cells` a side in the first octave."""
    u, v = coordinates(size)
    total = np.zeros((size, size))
    for octave in range(octaves):
        n = cells << octave
        grid = np.random.default_rng((seed, octave)).uniform(-1, 1, (n, n))
        x, y = u * n, v * n
        i, j = x.astype(int), y.astype(int)
        s, t = smooth(x - i), smooth(y - j)
        above = grid[j % n, i % n] * (1 - s) + grid[j % n, (i + 1) % n] * s
        below = grid[(j + 1) % n, i % n] * (1 - s) + grid[(j + 1) % n, (i + 1) % n] * s
        total += (above * (1 - t) + below * t) / 2**octave
    return total


def smooth(x):
    return x * x * (3 - 2 * x)


def mix(first, second, share):
    """Colours `first` to `second`, by `share` of shape (height, width)."""
    share = np.clip(share, 0, 1)[..., None]
    return np.asarray(first) * (1 - share) + np.asarray(second) * share


def bricks(size=1024, rows=24, columns=10, seed=1):
    """Bricks of slightly different colours in light mortar."""
    u, v = coordinates(size)
    row = (v * rows).astype(int)
    x = u * columns + 0.5 * (row % 2)
    tone = np.random.default_rng(seed).uniform(0, 1, (rows, columns))[row, x.astype(int) % columns]
    colour = mix((0.42, 0.14, 0.08), (0.62, 0.30, 0.18), tone + 0.3 * noise(size, 64, seed))
    gap_u, gap_v = np.abs(x % 1 - 0.5), np.abs((v * rows) % 1 - 0.5)
    mortar = (gap_u > 0.475) | (gap_v > 0.44)
    return np.where(mortar[..., None], mix((0.62, 0.6, 0.55), (0.5, 0.48, 0.44), noise(size, 128, seed + 1)), colour)


def planks(size=1024, count=8, seed=2):
    """Wooden planks along v with grain."""
    u, v = coordinates(size)
    plank = (u * count).astype(int)
    shift = np.random.default_rng(seed).uniform(0, 1, (count, 2))[plank]
    grain = np.sin(40 * np.pi * (u * count + 0.35 * noise(size, 4, seed)) + 9 * shift[..., 0]) * 0.5 + 0.5
    colour = mix(
        (0.30, 0.16, 0.07), (0.58, 0.36, 0.18), 0.35 * grain + 0.5 * shift[..., 1] + 0.25 * noise(size, 64, seed)
    )
    return np.where((np.abs((u * count) % 1 - 0.5) > 0.485)[..., None], 0.25 * colour, colour)


def weave(size=1024, threads=96, first=(0.75, 0.70, 0.58), second=(0.16, 0.22, 0.42), seed=3):
    """Plain weave: threads of two colours over and under each other."""
    u, v = coordinates(size)
    x, y = u * threads, v * threads
    over = (x.astype(int) + y.astype(int)) % 2 == 0
    roundness = np.where(over, 1 - (2 * (y % 1) - 1) ** 2, 1 - (2 * (x % 1) - 1) ** 2)
    tone = 0.35 + 0.65 * roundness + 0.15 * noise(size, 128, seed, 2)
    return np.clip(np.where(over[..., None], first, second) * tone[..., None], 0.01, 0.95)


def checker(size=512, count=8, first=(0.75, 0.73, 0.68), second=(0.08, 0.09, 0.11), seed=4):
    """Checks with some dirt."""
    u, v = coordinates(size)
    even = ((u * count).astype(int) + (v * count).astype(int)) % 2 == 0
    return np.clip(np.where(even[..., None], first, second) * (1 + 0.25 * noise(size, 16, seed))[..., None], 0.01, 0.95)


def wallpaper(size=1024, count=14, seed=5):
    """Stripes and dots on a pale ground."""
    u, v = coordinates(size)
    ground = mix((0.72, 0.70, 0.60), (0.60, 0.64, 0.60), 0.5 + 0.5 * np.sign(np.sin(2 * np.pi * count * u)))
    x, y = (u * count) % 1 - 0.5, (v * count) % 1 - 0.5
    dot = (x * x + y * y < 0.035) ^ (x * x + y * y < 0.012)
    return np.clip(
        np.where(dot[..., None], (0.45, 0.16, 0.14), ground) * (1 + 0.1 * noise(size, 32, seed))[..., None], 0.01, 0.95
    )


def ground(size=1024, seed=6):
    """Earth with stones."""
    coarse, fine = noise(size, 8, seed), noise(size, 64, seed + 1)
    return np.clip(mix((0.13, 0.09, 0.05), (0.36, 0.30, 0.20), 0.5 + 0.4 * coarse + 0.5 * fine), 0.01, 0.95)


def speckle(size=512, seed=7, dark=(0.10, 0.12, 0.15), light=(0.80, 0.78, 0.72)):
    """Terrazzo: hard-edged specks on a pale ground."""
    return mix(light, dark, (noise(size, 24, seed, 3) > 0.35).astype(float) + 0.1 * noise(size, 64, seed + 1))


def sky(height=256, sun_direction=(0.5, 0.45, 0.6), sun_degrees=1.2, sun_radiance=9000.0):
    """Latitude-longitude radiance, y up, of a clear sky over dark land with a small sun; (height, 2 height, 3)."""
    width = 2 * height
    theta = np.pi * (np.arange(height) + 0.5) / height
    phi = 2 * np.pi * (np.arange(width) + 0.5) / width
    phi, theta = np.meshgrid(phi, theta)
    # Mitsuba's convention: u = 0.5 looks along -z.
    direction = np.stack([np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)], -1)
    up = np.clip(direction[..., 1], 0, 1)
    radiance = mix((0.95, 0.98, 1.05), (0.16, 0.32, 0.75), up**0.5)
    radiance[direction[..., 1] < 0] = (0.10, 0.09, 0.08)
    sun = np.asarray(sun_direction) / np.linalg.norm(sun_direction)
    radiance[direction @ sun > np.cos(np.radians(sun_degrees))] = sun_radiance * np.array([1.0, 0.9, 0.75])
    return radiance
