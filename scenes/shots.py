"""Shots, to measure what neighbouring frames give: `python -m scenes.shots OUT`.

Of every shot, in OUT/SHOT: {a,b}.FRAME.exr, half of the samples each, with the half's denoised picture, albedo and
normal, and what motion is found from: Cycles' Vector pass, or world positions with the camera's matrix (Mitsuba);
denoised.FRAME.exr of the full buffer, ref.FRAME.exr with both its halves. Half floats (positions, motion single), ZIP.
Every frame and half has a seed of its own.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from . import frame
from .command import seed_of, size
from .worker import Worker


@dataclass(frozen=True)
class Shot:
    """Frames 1001 and on; `hard` is what neighbours make hard in it."""

    renderer: str
    frames: int
    # Samples of a frame, and of its reference.
    spp: int
    reference_spp: int
    hard: str


SHOTS = {
    "lantern": Shot(
        "cycles_shot", 6, 16, 384, "a lamp that swings and one that flickers, fur, glass and metal that move"
    ),
    "glass-orbit": Shot(
        "mitsuba_shot", 6, 64, 1024, "a camera around glass and caustics, a lamp that dims; positions, no motion pass"
    ),
    "shutter": Shot(
        "cycles_shot",
        6,
        16,
        384,
        "motion blur: noisy features, no motion pass; two views, with a cut after the third frame",
    ),
}
# Samples that are rendered at a time.
PASS_SPP = 64


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--shot", action="append", choices=SHOTS)
    parser.add_argument("--size", type=size, default=(320, 180))
    parser.add_argument("--threads", type=int, default=0)
    for field in ("frames", "spp", "reference_spp"):
        parser.add_argument(f"--{field.replace('_', '-')}", type=int, help="instead of the shot's own")
    options = parser.parse_args(arguments)
    given = {field: getattr(options, field) for field in ("frames", "spp", "reference_spp")}
    for name in options.shot or SHOTS:
        shot = replace(SHOTS[name], **{field: value for field, value in given.items() if value})
        for number in range(1, shot.frames + 1):
            folder, last = options.output / name, f"ref.{1000 + number}.exr"
            if not (folder / last).is_file():
                with Worker(shot.renderer, name, number, options.size, options.threads) as worker:
                    write_frame(folder, shot, name, number, worker)
                print(folder / last, flush=True)
    return 0


def write_frame(folder, shot, name, number, worker):
    """Both halves, the full buffer's denoised picture and, last, the reference of a frame."""
    halves = [rendered(worker, shot.spp // 2, name, number, half) for half in "ab"]
    for half, buffers in zip("ab", halves, strict=True):
        frame.write(
            folder / f"{half}.{1000 + number}.exr",
            {role: plane for role, plane in buffers.items() if role != "camera"}
            | {"denoised": frame.denoised(buffers)},
            {"worldToNDC": buffers["camera"].astype(np.float32)} if "camera" in buffers else {},
        )
    whole = frame.averaged(*({role: half[role] for role in ("color", "albedo", "normal")} for half in halves))
    frame.write(folder / f"denoised.{1000 + number}.exr", {"color": frame.denoised(whole)})
    references = [rendered(worker, shot.reference_spp // 2, name, number, f"reference {half}") for half in "ab"]
    frame.write_reference(folder, *(half["color"] for half in references), f"ref.{1000 + number}.exr")


def rendered(worker, spp, *key):
    """Buffers by role, the mean of `spp` samples. Motion and camera are those of the first part."""
    sums, done = {}, 0
    while done < spp:
        samples = min(PASS_SPP, spp - done)
        buffers = worker.render(samples, seed_of("shot", *key, done))
        for role, plane in buffers.items():
            if role in ("motion", "camera"):
                sums.setdefault(role, plane)
            else:
                sums[role] = sums.get(role, 0) + samples / spp * plane
        done += samples
    return sums


if __name__ == "__main__":
    sys.exit(main())
