"""From a scene to the corrected picture, as steps that an operator takes one after the other."""

import json
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy

from . import exr, picture, programs
from .halves import halves
from .settings import programs_folder

# Of the pictures that are saved.
NAME = "corrected"


class Failed(Exception):
    """The correction cannot be done; says why."""


@dataclass
class Render:
    """A still of the scene as it is set up, written to its file."""

    text: str
    path: Path


@dataclass
class Run:
    """A program with its arguments."""

    text: str
    command: list


class Correction:
    """The current frame, or the animation; `steps` does it, then `message` and `level` tell how it went."""

    def __init__(self, context, animation):
        scene = context.scene
        self.scene, self.settings, self.animation = scene, scene.sspc, animation
        self.frames = list(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))
        if not animation:
            self.frames = [scene.frame_current]
        self.train, self.infer = (
            programs.find(f"sspc-{name}", programs_folder(context)) for name in ("train", "infer")
        )
        self.saved = self.folder() if animation or self.settings.save or self.settings.keep else None
        self.total = 2 * len(self.frames) + (2 if animation else 1)
        self.message, self.level = "", "INFO"

    def folder(self):
        """The folder for pictures, made when absent."""
        name = self.settings.folder
        if name.startswith("//") and not bpy.data.filepath:
            raise Failed(f"The folder {name} lies beside a file that was never saved: save it, or name another folder")
        path = Path(bpy.path.abspath(name))
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Failed(f"Cannot make the folder {path}: {error.strerror}") from error
        return path

    def steps(self):
        """The renders and programs in order; closed at any of them, it restores the scene and removes what it began."""
        # Halves of an animation are large: beside the pictures rather than in a folder that may lie in memory.
        place = self.saved if self.animation else None
        with tempfile.TemporaryDirectory(prefix="sspc-", dir=place, ignore_cleanup_errors=True) as scratch:
            scratch = Path(scratch)
            with halves(self.scene, self.settings.split) as scene:
                for frame in self.frames:
                    for half in "ab":
                        path = scratch / f"{half}.{frame:04}.exr"
                        scene.show(half, frame, path)
                        yield Render(f"Rendering half {half} of frame {frame}", path)
                        if not path.is_file():
                            raise Failed(f"Blender has not written half {half} of frame {frame}")
            yield Run("Fitting", self.fit(scratch))
            if self.animation:
                yield Run("Correcting", self.correct(scratch))
            self.finish(scratch)

    def fit(self, scratch):
        chosen = spread(self.frames, self.settings.fit_frames)
        more = ["--preset", self.settings.preset, "--seed", str(self.settings.seed), "-o", str(scratch / "fit")]
        return [self.train, "fit", *shot(scratch, chosen), *self.shared(), *more]

    def correct(self, scratch):
        model, pictures = scratch / "fit" / "model.onnx", scratch / f"{NAME}.####.exr"
        return [
            *[self.infer, "run", "--model", str(model), "--json", *shot(scratch, self.frames)],
            *[*self.shared(), "-o", str(pictures)],
        ]

    def shared(self):
        """Arguments that both programs take."""
        render = self.scene.render
        threads = ["--threads", str(render.threads)] if render.threads_mode == "FIXED" else []
        return ["--strength", f"{self.settings.strength:.3f}", *threads]

    def finish(self, scratch):
        """Saves and shows pictures, and tells how it went."""
        reports = {}
        for frame in self.frames:
            file, report = self.result(scratch, frame)
            reports[frame] = json.loads(report.read_text(encoding="utf-8"))
            pixels, saved = picture.read(file, reports[frame]), None
            if self.animation or self.settings.save:
                saved = self.saved / f"{NAME}.{frame:04}.exr"
                exr.write(saved, pixels)
            picture.show(pixels, saved)
            if self.settings.keep:
                shutil.copyfile(file, self.saved / f"{NAME}-passes.{frame:04}.exr")
                for half in "ab":
                    name = f"{half}.{frame:04}.exr"
                    shutil.copyfile(scratch / name, self.saved / name)
        if self.settings.keep:
            shutil.copytree(scratch / "fit", self.saved / "fit", dirs_exist_ok=True)
        self.tell(reports)

    def result(self, scratch, frame):
        """A corrected file with all passes, and its figures."""
        if self.animation:
            stem = scratch / f"{NAME}.{frame:04}"
            return Path(f"{stem}.exr"), Path(f"{stem}.json")
        fitted = scratch / "fit"
        return fitted / f"{NAME}.{frame}.exr", fitted / f"report.{frame}.json"

    def tell(self, reports):
        """What a person should know, the worst first."""
        several = len(reports) > 1
        notes = []
        for frame, report in reports.items():
            of = f"frame {frame}: " if several else ""
            if report.get("fallback"):
                notes.append(f"{of}the picture is the denoiser's: {report['fallback']}")
            notes += [of + note for note in report["warnings"] if "halves show different things" in note]
        if notes:
            self.level, self.message = "WARNING", "; ".join(notes)
            return
        estimates = [report["estimate"] for report in reports.values()]
        ratios = [it["corrected"]["value"] / it["denoised"]["value"] for it in estimates if it["denoised"]["value"] > 0]
        mean = f", estimated error {sum(ratios) / len(ratios):.2f} of the denoiser's" if ratios else ""
        where = f" in {self.saved}" if self.saved else ""
        what = f"{len(reports)} frames" if several else "the frame"
        self.message = f"Corrected {what}{where}{mean}"


def shot(scratch, frames):
    """The arguments that name frames."""
    listed = ",".join(str(frame) for frame in frames)
    return ["--a", str(scratch / "a.####.exr"), "--b", str(scratch / "b.####.exr"), "--frames", listed]


def spread(frames, count):
    """At most `count` of the frames, evenly spread, the first and the last among them."""
    if count >= len(frames):
        return frames
    if count == 1:
        return [frames[len(frames) // 2]]
    return [frames[round(at * (len(frames) - 1) / (count - 1))] for at in range(count)]
