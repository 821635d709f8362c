"""Shots as wholes: one model for all frames, with neighbours and without, beside training each frame by itself."""

import itertools
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from .runs import Failed, Programs, checked_process

EACH = "each frame by itself"
ALONE = "one model, no neighbours"
NEIGHBOURS = "one model, neighbours"
# Arguments of `fit` and `run` by way.
WAYS = {EACH: ("--extra-frames", "0"), ALONE: ("--extra-frames", "0"), NEIGHBOURS: ()}

# Folder of the pictures of a way.
CORRECTED = "corrected"

NOTE = (
    "One model is fitted for the shot and run on all its frames, with neighbouring frames as by default and without, "
    "beside each frame's own training. relL2, temporal error and the ratio across the reference's halves are relative "
    "to the denoiser's, over the whole shot. JOD is that of the shot as a video (ColorVideoVDP), 10 at most, and "
    "`denoised` the denoiser's. Worst frame: its relL2 over that of its own training. `fit s`: the whole processes; "
    "`train s a frame`: training alone, divided by the frames of the shot, and then over that of each frame's own."
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


@dataclass(frozen=True)
class Setting:
    """What every way of a benchmark's shots has in common."""

    programs: Programs
    environment: dict
    # Longest process in seconds.
    limit: float
    # Steps per fit of a trial.
    steps: int | None = None


def run(shot, way, preset, seed, setting, folder):
    """One way of one shot, its files in `folder`; its entry in the record, with the reason if it failed."""
    result = {"shot": shot.name, "way": way, "preset": preset, "seed": seed, "frames": len(shot.numbers)}
    fit = [str(setting.programs.train), "fit", *shot.arguments(), "--preset", preset, "--seed", str(seed), "--quiet"]
    fit += [*(("--steps", str(setting.steps)) if setting.steps else ()), *WAYS[way]]
    try:
        (folder / CORRECTED).mkdir(parents=True, exist_ok=True)
        make = each_frame if way == EACH else one_model
        result |= make(shot, fit, setting, folder)
        result["evaluation"] = evaluated(shot, setting, folder)
    except Failed as failure:
        return result | {"failure": str(failure)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        return result | {"failure": f"unreadable answer: {type(error).__name__}: {error}"}
    return result | {"failure": None}


def each_frame(shot, fit, setting, folder):
    walls, reports = [], []
    for number in shot.numbers:
        place = folder / number
        command = [*fit, "--frames", str(int(number)), "-o", str(place)]
        walls.append(checked_process("sspc-train fit", command, setting.environment, setting.limit).wall_seconds)
        reports.append(of_report(place))
        os.replace(min(place.glob("corrected*.exr")), folder / CORRECTED / f"{number}.exr")
    trained = sum(report["train_seconds"] for report in reports)
    return reports[0] | {"fit_seconds": sum(walls), "train_seconds": trained, "run_seconds": None}


def one_model(shot, fit, setting, folder):
    place = folder / "model"
    command = [*fit, "--frames", shot.listed, "-o", str(place)]
    fitted = checked_process("sspc-train fit", command, setting.environment, setting.limit)
    command = [str(setting.programs.infer), "run", "--model", str(place / "model.onnx"), *shot.arguments()]
    command += ["--frames", shot.listed, "-o", corrected(shot, folder)]
    done = checked_process("sspc-infer run", command, setting.environment, setting.limit)
    return of_report(place) | {"fit_seconds": fitted.wall_seconds, "run_seconds": done.wall_seconds}


def of_report(place):
    """Threads, and seconds of training alone; every report of a fit has them."""
    report = json.loads(min(place.glob("report*.json")).read_text())
    return {"threads": report.get("threads"), "train_seconds": report["seconds"]["train"]}


def corrected(shot, folder):
    return str(folder / CORRECTED / f"{'#' * len(shot.numbers[0])}.exr")


def evaluated(shot, setting, folder):
    """What a record keeps of the pictures' figures: those of the shot, and of each frame what is in the table."""
    command = [str(setting.programs.infer), "evaluate", corrected(shot, folder), "--frames", shot.listed, "--json"]
    command += ["--reference", shot.pattern("ref"), "--denoised", shot.pattern("denoised")]
    text = checked_process("sspc-infer evaluate", command, setting.environment, setting.limit).stdout
    found = json.loads(text)
    frames = [
        {
            "frame": frame["frame"],
            "rel_l2": frame["figures"]["rel_l2"],
            "rel_l2_ratio": frame["denoised"]["rel_l2_ratio"],
            "temporal": frame["temporal"],
            "jod": frame["jod"],
        }
        for frame in found["frames"]
    ]
    return found | {"frames": frames}


def measure(shots, presets, seeds, setting, scratch, keep, say):
    """Every way of every shot; `say` tells of each. Ends early on Ctrl-C; returns the results and how it ended."""
    results = []
    try:
        for shot in shots:
            for preset, seed in itertools.product(presets, seeds):
                for way in WAYS:
                    place = (keep or scratch) / f"{shot.name}-{preset}-seed{seed}-{list(WAYS).index(way)}"
                    results.append(run(shot, way, preset, seed, setting, place.resolve()))
                    say(line(results[-1]), loud=bool(results[-1]["failure"]))
                    if not keep:
                        shutil.rmtree(place, ignore_errors=True)
    except KeyboardInterrupt:
        return results, "interrupted"
    return results, "ran to its end"


def line(result):
    start = f"{result['shot']}, {result['preset']}, seed {result['seed']}, {result['way']}: "
    if result["failure"]:
        return f"{start}FAILED: {result['failure']}"
    own = result["evaluation"]["denoised"]
    temporal = f", temporal {own['temporal_ratio']:.3f}" if own["temporal_ratio"] is not None else ""
    return f"{start}{own['rel_l2_ratio']:.3f} of the denoiser's{temporal}, fit {result['fit_seconds']:.1f} s"


@dataclass(frozen=True)
class Row:
    """A way of a shot, mean over the seeds; None: not known."""

    shot: str
    preset: str
    way: str
    rel_l2_ratio: float
    temporal_ratio: float | None
    crossed_ratio: float | None
    jod: float | None
    denoised_jod: float | None
    # Ratio of the relL2 of the frame that is worst against its own training, and its number.
    worst: tuple[float, int] | None
    fit_seconds: float
    run_seconds_per_frame: float | None
    train_seconds_per_frame: float
    # Over that of training each frame by itself.
    train_ratio: float | None


def rows(results):
    """One row for each way of each shot and preset that has a result."""
    grouped = {}
    for result in results:
        if not result["failure"]:
            grouped.setdefault((result["shot"], result["preset"], result["way"]), []).append(result)
    return [row(key, group, grouped.get((*key[:2], EACH), [])) for key, group in grouped.items()]


def row(key, group, single):
    def mean(value):
        known = [value(result) for result in group]
        return None if None in known else fmean(known)

    def own(name):
        return mean(lambda result: result["evaluation"]["denoised"][name])

    train = mean(lambda result: result["train_seconds"])
    of_single = fmean(result["train_seconds"] for result in single) if single else None
    return Row(
        *key,
        rel_l2_ratio=own("rel_l2_ratio"),
        temporal_ratio=own("temporal_ratio"),
        crossed_ratio=own("crossed_ratio"),
        jod=mean(lambda result: result["evaluation"]["jod"]),
        denoised_jod=own("jod"),
        worst=worst(group, single),
        fit_seconds=mean(lambda result: result["fit_seconds"]),
        run_seconds_per_frame=mean(lambda r: r["run_seconds"] and r["run_seconds"] / r["frames"]),
        train_seconds_per_frame=train / group[0]["frames"],
        train_ratio=train / of_single if of_single else None,
    )


def worst(group, single):
    by_seed = {result["seed"]: result["evaluation"]["frames"] for result in single}
    pairs = [
        (ours["rel_l2"] / theirs["rel_l2"], ours["frame"])
        for result in group
        for ours, theirs in zip(result["evaluation"]["frames"], by_seed.get(result["seed"], []))
    ]
    return max(pairs, default=None)


HEADINGS = (
    "shot", "preset", "way", "relL2", "temporal", "across halves", "JOD", "denoised", "worst frame", "fit s",
    "run s a frame", "train s a frame", "÷ own training",
)  # fmt: skip


def cells(row):
    """A row as text."""

    def number(value, digits=3):
        return "-" if value is None else f"{value:.{digits}f}"

    return [
        row.shot,
        row.preset,
        row.way,
        *map(number, (row.rel_l2_ratio, row.temporal_ratio, row.crossed_ratio, row.jod, row.denoised_jod)),
        f"{row.worst[0]:.3f} {row.worst[1]}" if row.worst else "-",
        number(row.fit_seconds, 1),
        number(row.run_seconds_per_frame, 2),
        number(row.train_seconds_per_frame, 2),
        number(row.train_ratio, 2),
    ]


def text(results, table):
    """The section's text, empty without a result; `table` makes a Markdown table."""
    found = rows(results)
    if not found:
        return ""
    return f"{NOTE}\n\n{table(HEADINGS, [cells(row) for row in found])}"


def plain(results):
    """Lines for a terminal, in columns."""
    lines = [HEADINGS, *(cells(row) for row in rows(results))]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEADINGS))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines]
