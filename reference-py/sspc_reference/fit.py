"""Fits the network to one frame by the self-supervised loss.

A schedule is a list of steps, a step is the tiles it looks at and the learning rate; both presets
below only write such a list, and `fit` carries any list out with Adam.
"""

import math
import random
from dataclasses import dataclass, replace

import torch

from . import activations, gc
from . import network as networks
from .features import part
from .loss import loss

# How far the network sees, in pixels: one per 3x3 layer. With this halo a tile's parameters come out
# as in the whole picture.
NETWORK_RADIUS = networks.HIDDEN_LAYERS + 1

# Larger batches are no faster: allocation takes the time.
PIXELS_AT_ONCE = 128 * 128


@dataclass(frozen=True)
class Tile:
    """A rectangle of the frame, in pixels."""

    top: int
    left: int
    height: int
    width: int


@dataclass(frozen=True)
class Step:
    tiles: list[Tile]
    rate: float


@dataclass(frozen=True)
class Adam:
    """Kingma and Ba's constants (their own defaults)."""

    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-8


@dataclass(frozen=True)
class Schedule:
    steps: list[Step]
    # Pixels around a tile that the network may look at while training; 0: each tile is an image of
    # its own to the network, zeros around it. The windows of g_c always reach into the picture.
    halo: int = 0
    adam: Adam = Adam()


def raw_outputs(network, half, tile, halo):
    """The network's outputs for one tile of a half's features, [1, P, tile height, tile width]."""
    height, width = half.shape[2:]
    top, left = max(tile.top - halo, 0), max(tile.left - halo, 0)
    bottom = min(tile.top + tile.height + halo, height)
    right = min(tile.left + tile.width + halo, width)
    raw = network(half[:, :, top:bottom, left:right])
    inside = Tile(tile.top - top, tile.left - left, tile.height, tile.width)
    return cut(raw, inside)


def cut(image, tile):
    """One tile of [B, C, H, W]."""
    return image[:, :, tile.top : tile.top + tile.height, tile.left : tile.left + tile.width]


def tiles_loss(network, frame, tiles, halo, radius=gc.RADIUS):
    """Eq. 9 over equally large tiles: a scalar with gradients."""

    def of_all(image, larger_by=0):
        """The tiles of one image as a batch, each `larger_by` pixels higher and wider."""
        return torch.cat(
            [cut(image, replace(tile, height=tile.height + larger_by, width=tile.width + larger_by)) for tile in tiles]
        )

    halves = (frame.a, frame.b)
    raw = torch.cat([raw_outputs(network, half, tile, halo) for half in halves for tile in tiles])
    padded = torch.cat([of_all(gc.mirror_pad(half, radius), 2 * radius) for half in halves])
    outputs = gc.gated_padded(padded, activations.activate(raw), radius)
    a, b = (of_all(half) for half in halves)
    noisy = part(a, "radiance"), part(b, "radiance")
    denoised = part(a, "denoised"), part(b, "denoised")
    return loss(*outputs.chunk(2), *noisy, *denoised)


def step_gradient(network, frame, tiles, halo, radius=gc.RADIUS):
    """Leaves the gradient of the tiles' mean loss in the network; returns that loss.

    The mean is over pixels: a smaller tile counts less.
    """
    network.zero_grad()
    pixels = sum(tile.height * tile.width for tile in tiles)
    total = 0.0
    for group in groups(tiles):
        share = sum(tile.height * tile.width for tile in group) / pixels
        value = tiles_loss(network, frame, group, halo, radius) * share
        value.backward()
        total += value.item()
    return total


def groups(tiles):
    """The tiles in groups of one size, small enough for one batch."""
    for size in sorted({(tile.height, tile.width) for tile in tiles}):
        equal = [tile for tile in tiles if (tile.height, tile.width) == size]
        at_once = max(PIXELS_AT_ONCE // (size[0] * size[1]), 1)
        for start in range(0, len(equal), at_once):
            yield equal[start : start + at_once]


def fit(network, frame, schedule, radius=gc.RADIUS, report=lambda step, loss: None):
    """Runs the schedule; returns the loss of every step, before its update."""
    adam = schedule.adam
    optimizer = torch.optim.Adam(network.parameters(), betas=(adam.beta1, adam.beta2), eps=adam.epsilon)
    losses = []
    for index, step in enumerate(schedule.steps):
        value = step_gradient(network, frame, step.tiles, schedule.halo, radius)
        if not math.isfinite(value):
            raise FloatingPointError(f"step {index}: the loss is {value}")
        for group in optimizer.param_groups:
            group["lr"] = step.rate
        optimizer.step()
        losses.append(value)
        report(index, value)
    return losses


def origins(length, size, stride):
    """Tile origins along one axis: every stride, and one flush with the end, so that every pixel is covered."""
    last = max(length - size, 0)
    return sorted({*range(0, last + 1, stride), last})


def paper_rate(frame):
    """0.01 sqrt(mean((y^a - y^b)^2 / 4)): the noise of the full buffer sets the learning rate."""
    difference = part(frame.a, "radiance") - part(frame.b, "radiance")
    return 0.01 * math.sqrt((difference.square() / 4).mean().item())


def paper_schedule(frame, seed, epochs=20, size=128, stride=64, batch=16):
    """The paper's: 20 epochs over 128x128 patches at stride 64, batches of 16 in random order."""
    height, width = frame.a.shape[2:]
    patches = [
        Tile(top, left, min(size, height), min(size, width))
        for top in origins(height, size, stride)
        for left in origins(width, size, stride)
    ]
    shuffle = random.Random(seed).shuffle
    rate = paper_rate(frame)
    steps = []
    for _ in range(epochs):
        shuffle(patches)
        steps += [Step(patches[start : start + batch], rate) for start in range(0, len(patches), batch)]
    return Schedule(steps)


def tile_schedule(frame, seed, steps, size=32, batch=16, rate=3e-3, warmup=10):
    """Random tiles; a linear warm-up, then half a cosine down to zero."""
    height, width = frame.a.shape[2:]
    tile_height, tile_width = min(size, height), min(size, width)
    draw = random.Random(seed).randint

    def tile():
        return Tile(draw(0, height - tile_height), draw(0, width - tile_width), tile_height, tile_width)

    def rate_at(step):
        rise = min(1, (step + 1) / warmup)
        return rate * rise * 0.5 * (1 + math.cos(math.pi * step / steps))

    return Schedule([Step([tile() for _ in range(batch)], rate_at(step)) for step in range(steps)])
