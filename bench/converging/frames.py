"""Frames of one scene at rising sample counts, rendered and denoised here, with the processor seconds of each step.

Files are kept: a second run measures nothing again that is there. `seconds.json` beside them holds
{"render": {"64": 12.3}, "denoise": {"64": {"oidn": 0.8}}, "reference_spp": 1024}: processor seconds of the rendering
process and of the denoiser, and the samples of the reference, which is rendered again where others are asked for.
"""

import json
import os
import time
from dataclasses import dataclass

import numpy as np

from scenes import frame as files
from scenes.catalogue import SCENES
from scenes.command import PASS_SPP, seed_of
from scenes.worker import Worker

# What a denoiser reads beside colour, by its name here. Both are OIDN, with and without features.
DENOISERS = {"oidn": ("albedo", "normal"), "oidn-colour": ()}
LABELS = {"oidn": "OIDN", "oidn-colour": "OIDN, colour only"}


@dataclass(frozen=True)
class Rendered:
    """Where the files of one scene lie."""

    folder: object
    scene: str

    def half(self, spp, name):
        return self.folder / f"{spp}spp.{name}.exr"

    def denoised(self, spp, denoiser, name):
        """The denoiser's picture of half `name` ("a" or "b") or of the full buffer ("full")."""
        return self.folder / f"{spp}spp.{denoiser}.{name}.exr"

    @property
    def reference(self):
        return self.folder / "ref.exr"

    @property
    def seconds_file(self):
        return self.folder / "seconds.json"

    def seconds(self):
        known = json.loads(self.seconds_file.read_text()) if self.seconds_file.is_file() else {}
        return {"render": {}, "denoise": {}} | known

    def keep_seconds(self, seconds):
        files.replace(self.seconds_file, lambda path: path.write_text(json.dumps(seconds, indent=1) + "\n"))


class TimedRenderer:
    """A renderer in a process of its own whose processor seconds are read from the system."""

    def __init__(self, scene, size, threads):
        self.worker = Worker(scene.renderer, scene.name, size, scene.depth, threads)

    def __enter__(self):
        self.worker.__enter__()
        # What every process does once (the scene, the kernels' compilation) is not the price of a sample.
        self.worker.render(1, 0)
        return self

    def __exit__(self, *error):
        self.worker.__exit__(*error)

    def render(self, spp, seed):
        """Buffers by role, and the processor seconds that they took."""
        before = processor_seconds(self.worker.process.pid)
        buffers = self.worker.render(spp, seed)
        return buffers, processor_seconds(self.worker.process.pid) - before


def processor_seconds(pid):
    """User and system seconds of a process, all its threads."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def render(rendered, counts, size, reference_spp, threads, say):
    """Renders and denoises what is missing of the sample counts `counts`, and the reference."""
    scene, seconds = SCENES[rendered.scene], rendered.seconds()
    missing = [spp for spp in counts if str(spp) not in seconds["denoise"]]
    has_reference = rendered.reference.is_file() and seconds.get("reference_spp") == reference_spp
    if not missing and has_reference:
        return
    with TimedRenderer(scene, size, threads) as renderer:
        for spp in missing:
            halves, spent = {}, 0.0
            for name in "ab":
                halves[name], took = summed(renderer, scene, spp // 2, (spp, name))
                spent += took
            seconds["render"][str(spp)] = spent
            seconds["denoise"][str(spp)] = denoise(rendered, spp, halves)
            rendered.keep_seconds(seconds)
            say(f"{scene.name}: {spp} spp rendered in {spent:.1f} processor seconds")
        if not has_reference:
            a, b = (summed(renderer, scene, reference_spp // 2, ("reference", name))[0]["color"] for name in "ab")
            files.write_reference(rendered.folder, a, b)
            seconds["reference_spp"] = reference_spp
            rendered.keep_seconds(seconds)
            say(f"{scene.name}: reference of {reference_spp} spp rendered")


def summed(renderer, scene, spp, key):
    """Buffers of `spp` samples, in passes of a bounded size, and their processor seconds."""
    total, spent, done = {}, 0.0, 0
    while done < spp:
        samples = min(PASS_SPP[scene.renderer], spp - done)
        buffers, took = renderer.render(samples, seed_of(scene.name, "convergence", *key, done))
        for role, planes in buffers.items():
            total[role] = total.get(role, 0.0) + samples * planes
        done, spent = done + samples, spent + took
    return {role: planes / spp for role, planes in total.items()}, spent


def denoise(rendered, spp, halves):
    """Writes both halves and every denoiser's pictures; returns processor seconds of one picture by denoiser."""
    for name, buffers in halves.items():
        files.write(rendered.half(spp, name), buffers)
    full = files.averaged(halves["a"], halves["b"])
    spent = {}
    for denoiser, features in DENOISERS.items():
        for name, buffers in {**halves, "full": full}.items():
            picture, spent[denoiser] = denoised(buffers, features)
            files.write(rendered.denoised(spp, denoiser, name), {"color": picture})
    return spent


def denoised(buffers, features):
    """OIDN's picture and its processor seconds, the second of two runs: the first of a size sets it up."""
    from pyoidn import denoise as oidn

    planes = [np.ascontiguousarray(buffers[role], dtype=np.float32) for role in ("color", *features)]
    for _ in range(2):
        before = time.process_time()
        picture = oidn(*planes, hdr=True, quality="high")
        spent = time.process_time() - before
    return picture, spent
