"""What a column's error, or its seconds, are worth in samples per pixel.

The noisy picture's relL2 falls with 1 / samples. The denoiser's is interpolated linearly in log-log between the sample
counts of its scene, and extrapolated with the nearest slope, or with the median slope of other scenes where a scene has
only one sample count.
"""

import math
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Ladder:
    """relL2 of one scene's denoised pictures by samples per pixel."""

    # (samples, relL2), by increasing samples, at least one.
    steps: tuple[tuple[float, float], ...]
    # d log(relL2) / d log(samples) where the scene has only one step; None: unknown.
    usual_slope: float | None

    def slopes(self):
        pairs = zip(self.steps, self.steps[1:])
        return [math.log(e1 / e0) / math.log(s1 / s0) for (s0, e0), (s1, e1) in pairs]

    def samples_for(self, error):
        """Samples at which the denoiser would reach this relL2; None where that is unknown."""
        slopes = self.slopes() or ([self.usual_slope] if self.usual_slope else [])
        if not slopes or any(slope >= 0 for slope in slopes) or not error > 0:
            return None
        # The segment that holds the error; the outer segments extend without end.
        index = next((i for i, (_, e) in enumerate(self.steps[1:]) if e <= error), len(slopes) - 1)
        samples, reached = self.steps[index]
        return samples * math.exp(math.log(error / reached) / slopes[index])

    def error_at(self, samples):
        """The denoiser's relL2 at this many samples; None with fewer than two steps."""
        if len(self.steps) < 2:
            return None
        above = next((i for i, (s, _) in enumerate(self.steps) if s >= samples), len(self.steps) - 1)
        (start, error), slope = self.steps[max(above, 1) - 1], self.slopes()[max(above, 1) - 1]
        return error * (samples / start) ** slope


@dataclass(frozen=True)
class EqualTime:
    """What a column's seconds would buy as samples."""

    # Samples per pixel after the column's seconds of further rendering; None where the frame's are unknown.
    spp: float | None
    factor: float
    # relL2 of the noisy and of the denoised picture there; None: see `Ladder.error_at`.
    noisy: float
    denoised: float | None


def equal_time(noisy, spp, render_seconds, extra_seconds, points):
    """`noisy` is relL2; `points` are (spp, relL2 of the denoised picture) of the same scene."""
    factor = 1 + extra_seconds / render_seconds
    more = spp * factor if spp else None
    known = Ladder(tuple(sorted((s, e) for s, e in points if s and e and e > 0)), None)
    return EqualTime(more, factor, noisy / factor, known.error_at(more) if more else None)


def ladders(points):
    """Ladders by scene; `points`: (scene, samples, relL2 of the denoised picture)."""
    by_scene = {}
    for scene, samples, error in points:
        if samples and error and error > 0:
            by_scene.setdefault(scene, {})[samples] = error
    own = {scene: Ladder(tuple(sorted(steps.items())), None) for scene, steps in by_scene.items()}
    known = [slope for ladder in own.values() for slope in ladder.slopes()]
    usual = median(known) if known else None
    return {scene: Ladder(ladder.steps, usual) for scene, ladder in own.items()}


@dataclass(frozen=True)
class Worth:
    """What one column's picture of one frame is worth."""

    frame: str
    column: str
    seconds: float
    # Factor on the samples that the noisy picture, and the denoiser, would need for this error.
    noisy_factor: float
    denoised_factor: float | None
    # The denoiser's factor uses the slopes of other scenes.
    borrowed: bool
    # Correction is the cheaper way where one sample per pixel of the frame takes longer than this many seconds; None
    # where the samples are unknown.
    break_even: float | None


def worth(frame, samples, noisy, corrected, column, seconds, ladder):
    """`noisy` and `corrected` are relL2; `ladder` is that of the frame's scene, None without one."""
    needed = ladder.samples_for(corrected) if ladder and samples else None
    factor = needed / samples if needed else None
    pays = factor is not None and factor > 1
    return Worth(
        frame,
        column,
        seconds,
        noisy / corrected,
        factor,
        bool(ladder) and len(ladder.steps) < 2,
        seconds / (needed - samples) if pays else None,
    )


def of_record(record):
    """Worth of every frame with a reference, a known sample count and a column that measured it.

    Other denoisings of a frame are left out: they have another ladder.
    """
    frames = [f for f in record.frames if f.variant is None and f.name in record.rows and record.rows[f.name].noisy]
    rows = record.rows
    known = ladders((f.scene, f.spp, rows[f.name].denoised) for f in frames)
    out = []
    for frame in frames:
        for heading, _, _ in record.columns:
            ratio, cell = record.ratio(frame.name, heading), record.cells.get((frame.name, heading))
            if ratio is not None:
                corrected = ratio * rows[frame.name].denoised
                ladder = known.get(frame.scene)
                out.append(
                    worth(frame.name, frame.spp, rows[frame.name].noisy, corrected, heading, cell.seconds, ladder)
                )
    return out


NOTE = (
    "Factor on the samples that would reach a column's error without it: first for the denoiser, then, in brackets, "
    "for the noisy picture (relL2 falls with 1 / samples). The denoiser's is interpolated in log-log between the "
    "sample counts of the scene; ~ : with the median slope of other scenes. Second line: correction is cheaper than "
    "more samples where one sample per pixel takes longer than this. Where render times are known, a table of equal "
    "times follows."
)


def text(record, table):
    """The section's text; `table` makes a Markdown table."""
    found = of_record(record)
    if not found:
        return "Not computed: no frame with a reference was measured."
    headings = [heading for heading, _, _ in record.columns]
    by_frame = {}
    for w in found:
        by_frame.setdefault(w.frame, {})[w.column] = cell_text(w)
    body = [[name, *(cells.get(heading, "-") for heading in headings)] for name, cells in by_frame.items()]
    return NOTE + "\n\n" + table(["frame", *headings], body)


def cell_text(w):
    denoised = "-" if w.denoised_factor is None else f"{'~' if w.borrowed else ''}{w.denoised_factor:.2g} ×"
    pays = f"<br>{w.break_even:.2g} s" if w.break_even is not None else ""
    return f"{denoised} ({w.noisy_factor:.2g} ×){pays}"
