"""Shots as wholes: one model for all frames, with neighbours and without, beside training each frame by itself."""

import json
import math
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from .runs import Failed, checked_process

EACH = "each frame by itself"
ALONE = "one model, no neighbours"
NEIGHBOURS = "one model, neighbours"
# Arguments of `fit` and `run` by way.
WAYS = {EACH: ("--extra-frames", "0"), ALONE: ("--extra-frames", "0"), NEIGHBOURS: ()}

NOTE = (
    "One model is fitted for the shot and run on all of its frames, with neighbouring frames as by default and without; "
    "beside it each frame's own training. relL2, temporal error and the ratio across the reference's halves are relative "
    "to the denoiser's (means of the shot); JOD is ColorVideoVDP's of the shot as a video, 10 at most. Worst frame: its "
    "relL2 over that of its own training. Training: seconds per frame of the shot, and over those of its own training."
)


@dataclass(frozen=True)
class Shot:
    """Frames that follow each other, with denoised pictures and references."""

    name: str
    folder: Path
    # As in the files' names.
    numbers: tuple[str, ...]
    denoised_halves: bool

    @property
    def listed(self):
        return ",".join(str(int(number)) for number in self.numbers)

    def pattern(self, name):
        return str(self.folder / f"{name}.{'#' * len(self.numbers[0])}.exr")

    def arguments(self):
        """Arguments of `fit` and `run` for the files of a frame."""
        roles = ["a", "b", "denoised", *(["denoised-a", "denoised-b"] if self.denoised_halves else [])]
        return [word for role in roles for word in (f"--{role}", self.pattern(role))]


def of(frames):
    """The shots of these frames that have at least two frames with denoised picture and reference."""
    grouped = {}
    for frame in frames:
        if frame.shot and frame.reference and frame.denoised:
            grouped.setdefault(frame.shot, []).append(frame)
    return [
        Shot(
            name=name,
            folder=group[0].a.parent,
            numbers=tuple(frame.name.rpartition("/")[2] for frame in group),
            denoised_halves=all(frame.denoised_a and frame.denoised_b for frame in group),
        )
        for name, group in grouped.items()
        if len(group) > 1
    ]


def run(shot, way, preset, steps, seed, programs, folder, environment, limit):
    """One way of one shot; its entry in the record, with the reason if it failed."""
    result = {"shot": shot.name, "way": way, "preset": preset, "seed": seed, "frames": len(shot.numbers)}
    try:
        (folder / "out").mkdir(parents=True, exist_ok=True)
        fit = [str(programs.train), "fit", *shot.arguments(), "--preset", preset, "--seed", str(seed), "--quiet"]
        fit += [*(("--steps", str(steps)) if steps else ()), *WAYS[way]]
        make = each if way == EACH else one_model
        result |= make(shot, fit, programs, folder, environment, limit)
        evaluate = [str(programs.infer), "evaluate", shot_pattern(shot, folder), "--frames", shot.listed, "--json"]
        evaluate += ["--reference", shot.pattern("ref"), "--denoised", shot.pattern("denoised")]
        text = checked_process("sspc-infer evaluate", evaluate, environment, limit).stdout
        result["evaluation"] = kept(json.loads(text))
    except Failed as failure:
        return result | {"failure": str(failure)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        return result | {"failure": f"unreadable answer: {type(error).__name__}: {error}"}
    return result | {"failure": None}


def shot_pattern(shot, folder):
    return str(folder / "out" / f"c.{'#' * len(shot.numbers[0])}.exr")


def each(shot, fit, programs, folder, environment, limit):
    walls, trained = [], []
    for number in shot.numbers:
        command = [*fit, "--frames", str(int(number)), "-o", str(folder / number)]
        walls.append(checked_process("sspc-train fit", command, environment, limit).wall_seconds)
        report, picture = written(folder / number, number)
        trained.append(report["seconds"]["train"])
        os.replace(picture, folder / "out" / f"c.{number}.exr")
    return {"fit_seconds": sum(walls), "train_seconds": sum(trained), "run_seconds": None}


def one_model(shot, fit, programs, folder, environment, limit):
    command = [*fit, "--frames", shot.listed, "-o", str(folder / "model")]
    fitted = checked_process("sspc-train fit", command, environment, limit)
    report, _ = written(folder / "model", shot.numbers[0])
    command = [str(programs.infer), "run", "--model", str(folder / "model" / "model.onnx"), *shot.arguments()]
    command += ["--frames", shot.listed, "-o", shot_pattern(shot, folder)]
    done = checked_process("sspc-infer run", command, environment, limit)
    return {
        "fit_seconds": fitted.wall_seconds,
        "train_seconds": report["seconds"]["train"],
        "run_seconds": done.wall_seconds,
    }
