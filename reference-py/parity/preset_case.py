"""The paper's preset on the sample frame: minutes of PyTorch, so made only when asked for."""

from pathlib import Path

import numpy as np
import torch
from sspc_reference import evaluate, fit, network, read
from sspc_reference.features import CHANNELS

from .case import Case, short

SAMPLE = Path(__file__).resolve().parents[2] / "tests" / "data" / "sample"
NAME = "paper-preset"
SEED = 7


def cases():
    frame = read.read_frame(SAMPLE / "a.exr", SAMPLE / "b.exr")
    reference = read.read_reference(SAMPLE / "ref.exr")
    net = network.Network()
    network.uniform_start(net, torch.Generator().manual_seed(SEED))
    net.load_flat(torch.from_numpy(short(net.flat().numpy())))
    schedule = fit.paper_schedule(frame, SEED)
    tile = schedule.steps[0].tiles[0]
    case = Case(
        NAME,
        "The paper's 20 epochs on the sample frame in float32: every step's loss and the final relL2.",
        {"kind": NAME, "frame": "tests/data/sample", "tile": tile.height},
    )
    case.put(
        rates=np.float32([step.rate for step in schedule.steps]),
        weights_start=net.flat().numpy(),
        origins=np.array([[[tile.top, tile.left] for tile in step.tiles] for step in schedule.steps], np.int32),
    )
    losses = fit.fit(net, frame, schedule)
    denoised = (frame.a + frame.b)[:, CHANNELS["denoised"]] / 2
    corrected = evaluate.corrected_image(net, frame)
    case.put(
        losses=np.array(losses),
        relative_l2=evaluate.relative_l2(corrected.double(), *doubled(reference)).reshape(1),
        relative_l2_denoised=evaluate.relative_l2(denoised.double(), *doubled(reference)).reshape(1),
    )
    return [case]


def doubled(reference):
    mean, halves = reference
    return mean.double(), [half.double() for half in halves]
