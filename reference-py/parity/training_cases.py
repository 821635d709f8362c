"""Twenty steps of Adam from given weights over given tiles, in both forms of the corrector."""

import dataclasses

import numpy as np
import torch
from sspc_reference import fit, gc, network, read

from .case import Case, Inputs, double, short, stack

# With Kingma and Ba's 1e-8 a weight whose gradient is nothing but rounding moves by a full rate all
# the same; the paper-preset case has that one.
ADAM = fit.Adam(epsilon=1e-5)
HEIGHT, WIDTH = 40, 48
STEPS, TILES, SIZE = 20, 3, 16


def start(outputs, seed):
    """Weights near the denoised image, in few digits."""
    net = network.Network(outputs)
    network.near_denoised_start(net, torch.Generator().manual_seed(seed))
    return short(net.flat().numpy())


def halves(random):
    """Two halves of one small frame that share all but the noise; float16 values, to stay small."""
    buffer = random.buffer(HEIGHT, WIDTH)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    texture = 0.5 + 0.4 * np.sin(columns / 2) * np.cos(rows / 3)
    truth = buffer["albedo"] * texture
    buffer["denoised"] = buffer["albedo"] * (0.5 + 0.2 * np.sin(columns / 2) * np.cos(rows / 3))
    result = []
    for _ in "ab":
        noise = random.uniform(3, HEIGHT, WIDTH, low=0.4, high=1.6)
        half = stack({**buffer, "radiance": truth * noise})
        result.append(short(half))
    return result


def tiles(random):
    tops = random.random.integers(0, HEIGHT - SIZE + 1, (STEPS, TILES))
    lefts = random.random.integers(0, WIDTH - SIZE + 1, (STEPS, TILES))
    # The first step has tiles flush with two opposite corners.
    tops[0, :2], lefts[0, :2] = [0, HEIGHT - SIZE], [0, WIDTH - SIZE]
    return np.stack([tops, lefts], axis=-1).astype(np.int32)


def check_not_chaotic(outputs, exact, rounded):
    """Refuses a case in which rounding alone decides where training goes; (losses, weights) twice."""
    losses = np.abs(np.array(rounded[0]) / exact[0] - 1).max()
    weights = (rounded[1] - exact[1]).norm() / exact[1].norm()
    if not (losses < 1e-4 and weights < 1e-4):
        raise ValueError(
            f"training of {outputs} outputs: float32 parts from float64 by {losses:.1e} in a loss, "
            f"{weights:.1e} in the weights"
        )


def cases():
    random = Inputs(61)
    case = Case(
        "training",
        "Twenty Adam steps in both forms: losses before each step, weights after the last.",
        {"kind": "training", "radius": gc.RADIUS, "tile": SIZE, "adam": dataclasses.asdict(ADAM)},
    )
    a, b = halves(random)
    origins = tiles(random)
    rates = np.float32(1e-3) * np.minimum(1, np.arange(1, STEPS + 1) / 5).astype(np.float32)
    case.put(features_a=a, features_b=b, origins=origins, rates=rates)
    steps = [
        fit.Step([fit.Tile(int(top), int(left), SIZE, SIZE) for top, left in row], float(rate))
        for row, rate in zip(origins, rates)
    ]
    for outputs in (15, 16):
        flat = start(outputs, seed=outputs)

        def train(precision, outputs=outputs, flat=flat):
            net = network.Network(outputs).to(precision)
            net.load_flat(torch.from_numpy(flat).to(precision))
            frame = read.Frame(double(a).to(precision), double(b).to(precision), None, [])
            return fit.fit(net, frame, fit.Schedule(steps, adam=ADAM)), net.flat()

        losses, end = train(torch.float64)
        check_not_chaotic(outputs, (losses, end), train(torch.float32))
        case.put(
            **{
                f"weights_start_{outputs}": flat,
                f"losses_{outputs}": np.array(losses),
                f"weights_end_{outputs}": end.float(),
            }
        )
    return [case]
