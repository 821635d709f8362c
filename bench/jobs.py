"""What to run: every method and preset on every frame it applies to, with every seed and repeat."""

from dataclasses import dataclass
from fnmatch import fnmatchcase
from statistics import fmean

from .frames import Frame

SSPC = "sspc"
FC = "f_c"
PAPER = "paper preset"
TORCH = "PyTorch, paper's schedule"
# Their names on the command line (--methods).
NAMES = {"sspc": SSPC, "fc": FC, "paper": PAPER, "torch": TORCH}
# f_c is measured with the network, start and steps of this preset.
FC_PRESET = "balanced"


@dataclass(frozen=True)
class Method:
    """A line of the plot: one program and its arguments, run with some presets."""

    name: str
    presets: tuple[str, ...]
    arguments: tuple[str, ...] = ()
    # Globs of the frames to run it on.
    frames: tuple[str, ...] = ("*",)
    # Longest run in seconds; None: the common limit.
    limit: float | None = None

    def is_for(self, frame):
        """Methods other than ours only serve comparison, so they need a reference.

        PyTorch reads its denoised halves from the files of the halves.
        """
        if not any(fnmatchcase(frame.name, glob) for glob in self.frames):
            return False
        return self.name == SSPC or bool(frame.reference) and not (self.name == TORCH and frame.denoised_a)


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


def methods(names, presets, others, steps, paper_frames=("*",), torch_frames=("*",), torch_limit=None):
    """The methods called `names`, and `others`: (name, arguments) pairs, each run with all presets.

    `steps` shortens every fit (a trial).
    """
    limit = ("--steps", str(steps)) if steps else ()
    found = []
    if "sspc" in names and presets:
        found.append(Method(SSPC, presets, limit))
    found += [Method(name, presets, (*arguments, *limit)) for name, arguments in others]
    if "fc" in names:
        found.append(Method(FC, (FC_PRESET,), ("--set", "combination=fc", *limit)))
    if "paper" in names:
        found.append(Method(PAPER, ("paper",), limit, paper_frames))
    if "torch" in names:
        found.append(Method(TORCH, ("paper",), ("--epochs", "1") if steps else (), torch_frames, torch_limit))
    return found


def jobs(frames, methods, seeds, repeats):
    """All jobs, frame by frame, so that an interrupted benchmark has whole rows."""
    return [
        Job(frame, method, preset, seed, repeat)
        for frame in frames
        for repeat in range(repeats)
        for seed in seeds
        for method in methods
        if method.is_for(frame)
        for preset in method.presets
    ]


def seconds_left(done, ahead):
    """Estimate of the remaining seconds from `done`, (column, seconds) pairs, and `ahead`, the columns still to run.

    A column not seen yet counts as the mean run; None before the first run.
    """
    if not done:
        return None
    mean = fmean(seconds for _, seconds in done)
    by_column = {}
    for name, seconds in done:
        by_column.setdefault(name, []).append(seconds)
    return sum(fmean(by_column[name]) if name in by_column else mean for name in ahead)
