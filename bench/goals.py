"""The project's goals on two cores, and whether the figures meet them."""

from dataclasses import dataclass, replace

from . import figures
from .frames import SAMPLE

SMALL = 640 * 360
LARGE = 1280 * 720
# One more goal for this frame alone.
LADDER_FRAME = "staircase/64spp"


@dataclass(frozen=True)
class Goal:
    """relL2 over the denoiser's (geometric mean) at least and aimed at, worst frame, staircase, seconds."""

    least: float
    aim: float
    worst: float
    staircase: float
    small_seconds: float
    large_seconds: float


GOALS = {
    "fast": Goal(0.88, 0.80, 1.01, 0.80, 2, 4),
    "balanced": Goal(0.80, 0.70, 1.01, 0.70, 6, 8),
    "quality": Goal(0.72, 0.62, 1.00, 0.62, 25, 40),
}


@dataclass(frozen=True)
class Verdict:
    preset: str
    what: str
    goal: str
    found: str
    # True, False, or None: not measured.
    met: bool | None

    @property
    def word(self):
        undecided = "not measured" if self.found == "-" else "not decided"
        return {True: "met", False: "**not met**", None: undecided}[self.met]


def verdicts(preset, frames, rows, cells):
    """Every goal of a preset against the figures."""
    goal = GOALS[preset]
    mean_frames = figures.judged(frames)
    mean = figures.mean_over(mean_frames, lambda f: ratio_of(cells, f.name, preset))
    lacking = figures.lacking(mean_frames, cells, preset)
    # The goals are for whole frames of several scenes, not for a crop of one.
    only_sample = all(frame.scene == SAMPLE for frame in mean_frames)
    worst = figures.worst(frames, cells, preset)
    staircase = ratio_of(cells, LADDER_FRAME, preset)

    def verdict(what, limit, value, shown=None):
        text = "-" if value is None else shown or f"{value:.3f}"
        return Verdict(preset, what, f"≤ {limit:g}", text, None if value is None else value <= limit)

    def unless_lacking(verdict, lacking, certain=None):
        """A figure that lacks frames, or is of the sample alone, is undecided, save a `certain` verdict: more frames
        could not change it.
        """
        if verdict.met is None or not (lacking or only_sample):
            return verdict
        why = f"{lacking} lacking" if lacking else "the sample alone"
        return replace(verdict, found=f"{verdict.found}, {why}", met=certain)

    worst_verdict = verdict("worst frame", goal.worst, worst and worst[0], worst and f"{worst[0]:.3f} ({worst[1]})")
    with_reference = [frame for frame in frames if frame.reference]
    harmed = False if worst_verdict.met is False else None
    return [
        unless_lacking(verdict("geometric mean, at least", goal.least, mean), lacking),
        unless_lacking(verdict("geometric mean, aim", goal.aim, mean), lacking),
        unless_lacking(worst_verdict, figures.lacking(with_reference, cells, preset), harmed),
        verdict(LADDER_FRAME, goal.staircase, staircase),
        beats_mix(preset, rows, cells),
        verdict("seconds, slowest frame of 640×360", goal.small_seconds, *slowest(preset, rows, cells, SMALL)),
        verdict("seconds, slowest frame of 1280×720", goal.large_seconds, *slowest(preset, rows, cells, LARGE)),
    ]


def ratio_of(cells, name, column):
    cell = cells.get((name, column))
    return cell.ratio if cell else None


def slowest(preset, rows, cells, pixels):
    """(seconds, text) of the slowest frame of that many pixels; (None, None) where there is none."""
    known = [
        (cells[name, preset].seconds, name)
        for name, row in rows.items()
        if row.pixels == pixels and (name, preset) in cells
    ]
    if not known:
        return None, None
    seconds, name = max(known)
    return seconds, f"{seconds:.2f} ({name})"


def beats_mix(preset, rows, cells):
    """Below the best fixed mix of noisy and denoised wherever that mix is below the denoiser at all."""
    lost, tried = [], 0
    for name, row in rows.items():
        mix, ratio = row.ratio(row.mix), ratio_of(cells, name, preset)
        if mix is not None and ratio is not None and mix < 1:
            tried += 1
            if ratio >= mix:
                lost.append(name)
    found = f"{tried - len(lost)} of {tried}" + (f", not: {', '.join(lost)}" if lost else "")
    goal = "every frame where the mix helps"
    return Verdict(preset, "below the best fixed mix", goal, found if tried else "-", not lost if tried else None)
