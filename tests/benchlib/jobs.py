"""What is to be run: every method and preset on every frame, with every seed, so many times."""

from dataclasses import dataclass
from statistics import fmean

from .frames import Frame

SSPC = "sspc"
PAPER = "paper preset"
TORCH = "PyTorch, paper's schedule"


@dataclass(frozen=True)
class Method:
    """A line of the plot: one program and its arguments, run with some presets."""

    name: str
    presets: tuple[str, ...]
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    frame: Frame
    method: Method
    preset: str
    seed: int
    repeat: int

    @property
    def column(self):
        """Heading in the tables."""
        return column(self.method.name, self.preset)


def column(method, preset):
    if method == SSPC:
        return preset
    return method if method in (PAPER, TORCH) else f"{method}, {preset}"


def methods(presets, paper, torch, others, steps):
    """`others`: (name, arguments) pairs, each run with all presets; `steps` shortens every fit (a trial)."""
    limit = ("--steps", str(steps)) if steps else ()
    found = [Method(SSPC, presets, limit)] if presets else []
    found += [Method(name, presets, (*arguments, *limit)) for name, arguments in others]
    if paper:
        found.append(Method(PAPER, ("paper",), limit))
    if torch:
        found.append(Method(TORCH, ("paper",), ("--epochs", "1") if steps else ()))
    return found


def jobs(frames, methods, seeds, repeats):
    """All jobs, frame by frame, so that an interrupted benchmark has whole rows.

    PyTorch reads its denoised halves from the files of the halves and is there to be compared, so it runs on
    frames that have them there and have a reference.
    """
    return [
        Job(frame, method, preset, seed, repeat)
        for frame in frames
        for repeat in range(repeats)
        for seed in seeds
        for method in methods
        for preset in method.presets
        if method.name != TORCH or (frame.reference and not frame.denoised_a)
    ]


def seconds_left(done, ahead):
    """Estimate from what is done: (column, seconds) pairs; `ahead`: the columns still to run.

    A column not seen yet is taken to last as long as the mean run; None before the first run.
    """
    if not done:
        return None
    mean = fmean(seconds for _, seconds in done)
    by_column = {}
    for name, seconds in done:
        by_column.setdefault(name, []).append(seconds)
    return sum(fmean(by_column[name]) if name in by_column else mean for name in ahead)
