"""From results to figures: one cell per frame and column, means over frames. Pure functions."""

import math
from dataclasses import dataclass
from statistics import fmean, median

from .frames import SAMPLE


@dataclass(frozen=True)
class Row:
    """A frame in the tables."""

    name: str
    pixels: int
    # relL2 of the noisy and the denoised picture, and of their best fixed mix (None: unknown).
    noisy: float | None
    denoised: float | None
    mix: float | None

    def ratio(self, value):
        return None if value is None or not self.denoised else value / self.denoised


@dataclass(frozen=True)
class Cell:
    """Figures of one column on one frame, over its seeds and repeats."""

    # relL2 over the denoiser's: geometric mean over the seeds; None without a reference.
    ratio: float | None
    # The same across the halves of the reference.
    crossed: float | None
    # Mean radiance of the picture over that of the reference: corrected, and denoised.
    brightness: float | None
    denoised_brightness: float | None
    # Whole-process wall seconds: median, least and most.
    seconds: float
    least_seconds: float
    most_seconds: float
    cpu_seconds: float
    peak_rss_bytes: int
    steps: int | None
    fallback: str | None


def geometric_mean(values):
    """Of positive numbers, at least one; raises ValueError otherwise."""
    values = list(values)
    if not values or any(not v > 0 or not math.isfinite(v) for v in values):
        raise ValueError(f"a geometric mean needs finite numbers above 0, found {values}")
    return math.exp(math.fsum(map(math.log, values)) / len(values))


def succeeded(results):
    return [result for result in results if not result["failure"]]


def rows(results, frames):
    """Rows by name, in the order of the frames, for frames that have a result."""
    by_name = {}
    for result in succeeded(results):
        known = result.get("rel_l2") or {}
        mix = (known.get("best_mix") or {}).get("rel_l2")
        row = by_name.get(result["frame"])
        if row is None or (row.mix is None and mix is not None):
            pixels = result.get("width", 0) * result.get("height", 0)
            row = Row(result["frame"], pixels, known.get("noisy"), known.get("denoised"), mix)
            by_name[result["frame"]] = row
    return {frame.name: by_name[frame.name] for frame in frames if frame.name in by_name}


def cells(results):
    """Cells by (frame, column)."""
    grouped = {}
    for result in succeeded(results):
        grouped.setdefault((result["frame"], result["column"]), []).append(result)
    return {key: cell(group) for key, group in grouped.items()}


def cell(group):
    ratios, crossed = {}, {}
    for result in group:
        if (result.get("crossed_ratio") or 0) > 0:
            crossed[result["seed"]] = result["crossed_ratio"]
        known = result.get("rel_l2")
        if known and known["denoised"] > 0 and known["corrected"] > 0:
            ratios[result["seed"]] = known["corrected"] / known["denoised"]
    walls = [result["wall_seconds"] for result in group]
    steps = [result["steps"] for result in group if result.get("steps") is not None]
    return Cell(
        ratio=geometric_mean(ratios.values()) if ratios else None,
        crossed=geometric_mean(crossed.values()) if crossed else None,
        brightness=mean_brightness(group, "evaluated"),
        denoised_brightness=mean_brightness(group, "evaluated_denoised"),
        seconds=median(walls),
        least_seconds=min(walls),
        most_seconds=max(walls),
        cpu_seconds=median(result["cpu_seconds"] for result in group),
        peak_rss_bytes=max(result["peak_rss_bytes"] for result in group),
        steps=round(median(steps)) if steps else None,
        fallback=next((result["fallback"] for result in group if result.get("fallback")), None),
    )


def mean_brightness(group, picture):
    known = [(result.get(picture) or {}).get("brightness") for result in group]
    known = [value for value in known if value is not None]
    return fmean(known) if known else None


def judged(frames):
    """The frames of a mean: those with a reference, as denoised; the sample (a crop) only if alone."""
    whole = [frame for frame in frames if frame.reference and frame.variant is None]
    others = [frame for frame in whole if frame.scene != SAMPLE]
    return others or whole


def mean_over(frames, value):
    """Geometric mean of value(frame), the frames of a shot counting as one; None where nothing is known."""
    groups = {}
    for frame in frames:
        known = value(frame)
        if known is not None:
            groups.setdefault(frame.shot or frame.name, []).append(known)
    if not groups:
        return None
    return geometric_mean(geometric_mean(group) for group in groups.values())


def lacking(frames, found, column):
    """Number of frames for which the column has no ratio: the run failed or was not made."""
    return sum((f.name, column) not in found or found[f.name, column].ratio is None for f in frames)


def worst(frames, found, column):
    """(ratio, frame name) of the column's worst frame, None where nothing is known."""
    known = [(found[f.name, column].ratio, f.name) for f in frames if (f.name, column) in found]
    known = [(ratio, name) for ratio, name in known if ratio is not None]
    return max(known) if known else None
