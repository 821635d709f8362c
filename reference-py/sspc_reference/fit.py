"""Fits the network to one frame by the self-supervised loss.

A schedule is a list of steps, a step is the tiles it looks at and the learning rate; both presets
below only write such a list, and `fit` carries any list out with Adam.
"""

import math
import random
from dataclasses import dataclass

import torch

from . import activations, gc, network as networks
from .features import part
from .loss import loss

# How far the network sees, in pixels: one per 3x3 layer.
NETWORK_RADIUS = networks.HIDDEN_LAYERS + 1


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
    # Pixels around each tile that the network and g_c may look at. 0: a tile is an image of its
    # own, padded and mirrored at its own border, as the paper's patches are.
    halo: int
    adam: Adam = Adam()


def full_halo(radius=gc.RADIUS):
    """The halo with which a tile's pixels come out as in the whole image.

    g_c of a pixel takes the parameters of that pixel alone, so the two footprints do not add up.
    """
    return max(NETWORK_RADIUS, radius)


def tile_loss(network, frame, tile, halo, radius=gc.RADIUS):
    """Eq. 9 over one tile: a scalar with gradients."""
    height, width = frame.a.shape[2:]
    top, left = max(tile.top - halo, 0), max(tile.left - halo, 0)
    bottom = min(tile.top + tile.height + halo, height)
    right = min(tile.left + tile.width + halo, width)
    window = torch.cat(
        [frame.a[:, :, top:bottom, left:right], frame.b[:, :, top:bottom, left:right]]
    )
    outputs = gc.gated(window, activations.activate(network(window)), radius)

    rows = slice(tile.top - top, tile.top - top + tile.height)
    columns = slice(tile.left - left, tile.left - left + tile.width)
    output_a, output_b = outputs[:, :, rows, columns].split(1)
    noisy_a, noisy_b = part(window, "radiance")[:, :, rows, columns].split(1)
    denoised_a, denoised_b = part(window, "denoised")[:, :, rows, columns].split(1)
    return loss(output_a, output_b, noisy_a, noisy_b, denoised_a, denoised_b)


def step_gradient(network, frame, tiles, halo, radius=gc.RADIUS):
    """Leaves the gradient of the tiles' mean loss in the network; returns that loss.

    The mean is over pixels: a smaller tile counts less.
    """
    network.zero_grad()
    pixels = sum(tile.height * tile.width for tile in tiles)
    total = 0.0
    for tile in tiles:
        value = tile_loss(network, frame, tile, halo, radius)
        share = tile.height * tile.width / pixels
        (value * share).backward()
        total += value.item() * share
    return total


def fit(network, frame, schedule, radius=gc.RADIUS, report=lambda step, loss: None):
    """Carries the schedule out; returns every step's loss, taken before its update."""
    adam = schedule.adam
    optimizer = torch.optim.Adam(
        network.parameters(), betas=(adam.beta1, adam.beta2), eps=adam.epsilon
    )
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
    """Tile origins along one axis: every stride, and one flush with the end so that all is seen."""
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
        steps += [
            Step(patches[start : start + batch], rate) for start in range(0, len(patches), batch)
        ]
    return Schedule(steps, halo=0)


def tile_schedule(frame, seed, steps, size=32, batch=16, rate=3e-3, warmup=10, radius=gc.RADIUS):
    """Random tiles in their context; a linear warm-up, then half a cosine down to zero."""
    height, width = frame.a.shape[2:]
    tile_height, tile_width = min(size, height), min(size, width)
    draw = random.Random(seed).randint

    def tile():
        return Tile(
            draw(0, height - tile_height), draw(0, width - tile_width), tile_height, tile_width
        )

    def rate_at(step):
        rise = min(1, (step + 1) / warmup)
        return rate * rise * 0.5 * (1 + math.cos(math.pi * step / steps))

    return Schedule(
        [Step([tile() for _ in range(batch)], rate_at(step)) for step in range(steps)],
        halo=full_halo(radius),
    )
