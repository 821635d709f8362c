"""Frames with finite differences, to measure the gradient term: `python -m scenes.gradients OUT`.

Of every scene, in OUT/SCENE: {N}spp.{a,b}.exr, half of the N samples each, with dx, dy and OIDN's picture of the half;
{N}spp.denoised.exr, of both; work/{3N}spp.{a,b,denoised}.exr without differences, for the same number of evaluations
(three a sample with differences, one without); and ref.exr, the mean and both halves of an independent reference.
Single floats, ZIP.
"""

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np

from . import frame
from .command import seed_of, size
from .worker import Worker

SCENES = ("fog", "door-crack", "uplight", "glass-table")
# Samples that are rendered at a time.
PASS_SPP = 32
NAMES = frame.CHANNELS | {role: tuple(f"{role}.{c}" for c in "RGB") for role in ("dx", "dy")}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--scene", action="append", choices=SCENES)
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 64])
    parser.add_argument("--reference-spp", type=int, default=512, help="of both halves together, 0: none")
    parser.add_argument("--size", type=size, default=(256, 144))
    parser.add_argument("--threads", type=int, default=0)
    options = parser.parse_args(arguments)
    for scene in options.scene or SCENES:
        folder = options.output / scene
        with_differences = partial(Worker, "mitsuba_gradients", scene, options.size, 10, options.threads)
        plain = partial(Worker, "mitsuba", scene, options.size, 10, options.threads)
        render(with_differences, folder, scene, options.spp)
        if options.reference_spp and not (folder / "ref.exr").is_file():
            with plain() as worker:
                a, b = (mean(worker, scene, options.reference_spp // 2, "reference", half)["color"] for half in "ab")
            write(folder / "ref.exr", {"color": 0.5 * (a + b), "a": a, "b": b})
            print(folder / "ref.exr", flush=True)
        render(plain, folder / "work", scene, [3 * spp for spp in options.spp])
    return 0


def render(worker, folder, scene, counts):
    """Writes the frames of these sample counts that are not there yet."""
    due = [spp for spp in counts if not (folder / f"{spp}spp.denoised.exr").is_file()]
    if not due:
        return
    with worker() as started:
        for spp in due:
            halves = {half: mean(started, scene, spp // 2, spp, half) for half in "ab"}
            for name, half in halves.items():
                write(folder / f"{spp}spp.{name}.exr", half | {"denoised": frame.denoised(half)})
            whole = frame.averaged(halves["a"], halves["b"])
            write(folder / f"{spp}spp.denoised.exr", {"color": frame.denoised(whole)})
            print(folder / f"{spp}spp", flush=True)


def mean(worker, scene, spp, *key):
    """Buffers by role, the mean of `spp` samples; every pass has a seed of its own."""
    sums, done = {}, 0
    while done < spp:
        samples = min(PASS_SPP, spp - done)
        for role, planes in worker.render(samples, seed_of(scene, "gradients", *key, done)).items():
            sums[role] = sums.get(role, 0) + samples / spp * planes
        done += samples
    return sums


def write(path, roles):
    """Writes planes of shape (height, width, channels) as single floats: differences are small beside y."""
    import OpenEXR

    planes = {
        name: np.ascontiguousarray(buffers[..., k], dtype=np.float32)
        for role, buffers in roles.items()
        for k, name in enumerate(NAMES[role])
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    frame.replace(path, lambda unfinished: OpenEXR.File(header, planes).write(str(unfinished)))


if __name__ == "__main__":
    sys.exit(main())
