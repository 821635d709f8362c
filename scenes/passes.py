"""Frames with additive passes, to measure how passes are corrected: `python -m scenes.passes OUT`.

Of every scene, in OUT/SCENE: {N}spp.{a,b}.exr, half of the N samples each, with every pass under its renderer's own
name, and ref.a.exr and ref.b.exr, two independent references of the same channels. Single floats, ZIP. Mitsuba has no
light groups: each is rendered by itself, and their sum is the beauty.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from . import frame
from .command import seed_of, size
from .worker import Worker

# Which renderer makes a scene's passes, and the samples of each reference.
SCENES = {
    "stage": ("cycles_passes", 256),
    "product": ("cycles_passes", 256),
    "fur-and-cloth": ("cycles_passes", 256),
    "many-lights": ("mitsuba_passes", 256),
    "fog": ("mitsuba_passes", 256),
}
# Samples that are rendered at a time.
PASS_SPP = 128


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("--scene", action="append", choices=SCENES)
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 64])
    parser.add_argument("--size", type=size, default=(384, 216))
    parser.add_argument("--threads", type=int, default=0)
    options = parser.parse_args(arguments)
    for scene in options.scene or SCENES:
        renderer, reference_spp = SCENES[scene]
        wanted = [(f"{spp}spp", spp // 2) for spp in options.spp] + [("ref", reference_spp)]
        due = [(options.output / scene / f"{name}.{half}.exr", spp, half) for name, spp in wanted for half in "ab"]
        due = [(path, spp, half) for path, spp, half in due if not path.is_file()]
        if due:
            with Worker(renderer, scene, options.size, 10, options.threads) as worker:
                for path, spp, half in due:
                    write(path, rendered(worker, scene, spp, half))
                    print(path, flush=True)
    return 0


def rendered(worker, scene, spp, half):
    """Channels by name, the mean of `spp` samples."""
    sums, done = {}, 0
    while done < spp:
        samples = min(PASS_SPP, spp - done)
        channels = worker.render(samples, seed_of(scene, f"passes {spp}", half, done))
        for name, plane in channels.items():
            sums[name] = sums.get(name, 0) + samples / spp * plane.astype(np.float64)
        done += samples
    return sums


def write(path, channels):
    import OpenEXR

    planes = {name: np.ascontiguousarray(plane, dtype=np.float32) for name, plane in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    frame.replace(path, lambda unfinished: OpenEXR.File(header, planes).write(str(unfinished)))


if __name__ == "__main__":
    sys.exit(main())
