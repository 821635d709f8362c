"""The command line: which frames are missing, who renders them, and progress."""

import argparse
import signal
import sys
import time
import zlib
from functools import partial
from pathlib import Path

import numpy as np

from . import frame
from .catalogue import SCENES
from .worker import Failed, Worker

DESCRIPTION = """\
Renders the scenes of this folder (geometry and textures are code; nothing is downloaded) with Mitsuba 3 and Blender
Cycles, denoises them with OIDN and leaves frames with references:

    scenes/render OUT
    bench/run --frames OUT

Existing files are kept, so an interrupted run resumes. Requirements: scenes/README.md."""

# Samples per pass. Progress is printed between passes; small ones bound Mitsuba's memory, Cycles prepares each anew.
PASS_SPP = {"mitsuba": 16, "cycles": 128}


def main(arguments=None):
    parser = command_line()
    options = parser.parse_args(arguments)
    if options.list:
        for scene in SCENES.values():
            say(f"{scene.name:14} {scene.renderer:8} {scene.hard}")
        return 0
    if not options.output:
        parser.error("OUT is missing")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for name in options.scene or SCENES:
            render_scene(SCENES[name], options)
    except KeyboardInterrupt:
        say("interrupted: finished files are kept")
        return 130
    except Failed as why:
        print(f"render: {why}", file=sys.stderr)
        return 4
    return 0


def render_scene(scene, options):
    """Renders the missing files of one scene."""
    folder = options.output / scene.name
    lacking = [spp for spp in options.spp if not frame.has_frame(folder, spp)]
    reference_spp = scene.reference_spp if options.reference_spp is None else options.reference_spp
    reference = reference_spp > 0 and not (folder / "ref.exr").is_file()
    if not lacking and not reference:
        return say(f"{scene.name}: complete")
    with Worker(scene.renderer, scene.name, options.size, scene.depth, options.threads) as worker:
        for spp in lacking:
            halves = [render_half(worker, scene, f"{spp} spp, half {half},", spp // 2, spp, half) for half in "ab"]
            frame.write_frame(folder, spp, *halves)
            say(f"{scene.name}: {spp} spp written")
        if reference:
            frame.write_reference(folder, *render_reference(worker, scene, reference_spp // 2, folder, options.size))
            partial_reference(folder).unlink(missing_ok=True)
            say(f"{scene.name}: reference written")


def render_reference(worker, scene, spp, folder, size):
    """Radiance of both halves of the reference, (height, width, 3), from `spp` samples each.

    The sums of the passes are kept in the scene's folder, so that an interrupted reference resumes.
    """
    kept, begin = partial_reference(folder), time.perf_counter()
    done, sums = 0, np.zeros((2, size[1], size[0], 3))
    if kept.is_file():
        with np.load(kept) as found:
            if found["sums"].shape == sums.shape and found["done"] < spp:
                done, sums = int(found["done"]), found["sums"]
    before = done
    while done < spp:
        samples = min(PASS_SPP[scene.renderer], spp - done)
        for index, half in enumerate("ab"):
            sums[index] += samples * worker.render(samples, seed_of(scene.name, "reference", half, done))["color"]
        done += samples
        frame.replace(kept, partial(np.savez, done=done, sums=sums))
        progress(scene, "reference, halves of", done, spp, before, begin)
    return sums / spp


def partial_reference(folder):
    return folder / ".reference.npz"


def render_half(worker, scene, label, spp, *key):
    """Buffers of one half, (height, width, channels) by role; every pass has its own seed."""
    begin, total, done = time.perf_counter(), {}, 0
    while done < spp:
        samples = min(PASS_SPP[scene.renderer], spp - done)
        buffers = worker.render(samples, seed_of(scene.name, *key, done))
        for role, planes in buffers.items():
            total[role] = total.get(role, 0.0) + samples * planes
        done += samples
        progress(scene, label, done, spp, 0, begin)
    return {role: planes / spp for role, planes in total.items()}


def progress(scene, label, done, spp, before, begin):
    """Prints samples done, seconds since `begin` (when `before` samples were done), and seconds left."""
    seconds = time.perf_counter() - begin
    left = seconds / (done - before) * (spp - done)
    say(f"{scene.name}: {label} {done} of {spp} samples, {seconds:.0f} s, {left:.0f} s left")


def seed_of(*key):
    """A seed for this key, the same in every run; other halves, passes and sample counts get other seeds."""
    return zlib.crc32(repr(key).encode()) & 0x7FFFFFFF


def command_line():
    parser = argparse.ArgumentParser(
        prog="scenes/render", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, nargs="?", metavar="OUT", help="folder for the scenes' folders")
    parser.add_argument(
        "--scene",
        action="append",
        choices=list(SCENES),
        metavar="NAME",
        help="only this scene; repeatable (--list names them)",
    )
    parser.add_argument(
        "--spp",
        type=even_numbers,
        default=[16, 64],
        metavar="16,64",
        help="samples per frame, both halves together (default 16,64)",
    )
    parser.add_argument("--size", type=size, default=(480, 270), metavar="WxH", help="pixels (default 480x270)")
    parser.add_argument(
        "--reference-spp",
        type=int,
        metavar="N",
        help="samples of the reference, 0: none (default: the scene's own, 512 or 1024)",
    )
    parser.add_argument("--threads", type=int, metavar="N", help="threads of the renderers (default: one per core)")
    parser.add_argument("--list", action="store_true", help="list the scenes and exit")
    return parser


def even_numbers(value):
    numbers = [int(part) for part in value.split(",")]
    if any(number < 2 or number % 2 for number in numbers):
        raise argparse.ArgumentTypeError(f"{value}: samples must be even, to be halved")
    return numbers


def size(value):
    width, mark, height = value.partition("x")
    if not mark or int(width) < 1 or int(height) < 1:
        raise argparse.ArgumentTypeError(f"{value} is not WIDTHxHEIGHT")
    return int(width), int(height)


def say(words):
    print(words, file=sys.stdout, flush=True)
