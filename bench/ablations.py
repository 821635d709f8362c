"""Ablations: one preset with one setting changed at a time, as a table of errors and processor seconds."""

import json
from dataclasses import asdict, dataclass

from . import figures
from .jobs import Job, Method, column

AS_IT_IS = "as it is"


@dataclass(frozen=True)
class Variant:
    """One change of the preset."""

    group: str
    name: str
    arguments: tuple[str, ...]


def of(group, *changes):
    """Variants that set one or more settings: ('side 7', 'window=7')."""
    return [
        Variant(group, name, tuple(word for setting in settings for word in ("--set", setting)))
        for name, *settings in changes
    ]


WITHOUT = {
    "no albedo": ("albedo",),
    "no normal": ("normal",),
    "no visibility": ("visibility",),
    "no feature at all": ("albedo", "normal", "visibility"),
}
VARIANTS = [
    Variant("", AS_IT_IS, ()),
    *of("function", ("f_c (Deep Combiner)", "combination=fc"), ("no gate (g_c alone)", "gate=none")),
    *of(
        "training",
        ("no influence limit", "influence=inf"),
        ("no gate, no influence limit", "gate=none", "influence=inf"),
    ),
    *of("picture", ("mean of halves, not judged", "composition=halves")),
    *(
        Variant("features", name, tuple(word for role in roles for word in ("--role", f"{role}=none")))
        for name, roles in WITHOUT.items()
    ),
    # Includes the preset's own size, whose row must equal the first one.
    *of("window", *((f"{side} x {side}", f"window={side}") for side in (7, 11, 15, 19, 25))),
    *of("first windows", ("whole from the start", "early-window=19"), ("9 x 9", "early-window=9")),
    # The kernels hold at most 16 channels.
    *of("hidden channels", *((f"{n}", f"hidden={n}") for n in (4, 8, 12, 16))),
    *of("convolutions", *((f"{n}", f"layers={n}") for n in (2, 3, 5, 9))),
]


@dataclass(frozen=True)
class Pair:
    """One skip, off and on."""

    name: str
    off: Variant
    on: Variant
    # Measured on frames whose right half is background, otherwise on the frames as they are.
    half_empty: bool = False


def named_variant(group, name):
    return next(v for v in VARIANTS if (v.group, v.name) == (group, name))


FEATURELESS = named_variant("features", "no feature at all")
PAIRS = [
    Pair("all skips, frames as they are", Variant("skip", "nothing skipped", ("--set", "skip=none")), VARIANTS[0]),
    Pair(
        "still blocks, right half background",
        Variant("half-empty", "still blocks computed", ("--set", "skip=features")),
        Variant("half-empty", "still blocks skipped", ()),
        half_empty=True,
    ),
    Pair(
        "absent features, no feature at all",
        Variant("skip", "absent features computed", (*FEATURELESS.arguments, "--set", "skip=blocks")),
        FEATURELESS,
    ),
]


def chosen(frames):
    """Frames of an ablation: those of the mean, of a shot only the first."""
    first = {}
    for frame in figures.judged(frames):
        first.setdefault(frame.shot or frame.name, frame)
    return list(first.values())


def jobs(frames, half_empty, preset, seeds, steps=None):
    """Every variant and every pair of skips on `frames`, frame by frame.

    `half_empty` holds the frames derived from them, by the names of the originals.
    """
    limit = ("--steps", str(steps)) if steps else ()

    def of_frame(frame, variants):
        methods = [Method(title(v), (preset,), (*v.arguments, *limit)) for v in variants]
        return [Job(frame, method, preset, seed, 0) for seed in seeds for method in methods]

    whole = [*VARIANTS, *(pair.off for pair in PAIRS if not pair.half_empty)]
    blank = [v for pair in PAIRS if pair.half_empty for v in (pair.off, pair.on)]
    todo = []
    for frame in frames:
        todo += of_frame(frame, whole)
        if frame.name in half_empty:
            todo += of_frame(half_empty[frame.name], blank)
    return todo


def title(variant):
    return f"{variant.group}: {variant.name}" if variant.group else variant.name


class Ablations:
    """Figures of all variants. `about` as a benchmark's record has it; `half_empty` as in `jobs`."""

    def __init__(self, about, frames, half_empty, preset, results):
        self.about, self.preset, self.results = about, preset, results
        self.cells = figures.cells(results)
        self.asked, self.half_empty = frames, half_empty
        # Means are over the frames that every variant has: an interrupted run leaves the last frame incomplete.
        self.frames = [f for f in frames if all(self.measured(f.name, v) for v in VARIANTS)]

    def measured(self, frame, variant):
        cell = self.cell(frame, variant)
        return cell is not None and cell.ratio is not None

    def cell(self, frame, variant):
        return self.cells.get((frame, column(title(variant), self.preset)))

    def mean(self, names, variant, value):
        """Geometric mean of value(cell) over the frames of these names."""
        return figures.geometric_mean(value(self.cell(name, variant)) for name in names)

    def against(self, names, variant, base, value):
        """value of a variant over that of `base`: geometric mean, and (largest, its frame)."""
        ratios = [(value(self.cell(name, variant)) / value(self.cell(name, base)), name) for name in names]
        return figures.geometric_mean(ratio for ratio, _ in ratios), max(ratios)

    def table(self, table):
        """For every variant: relL2 ÷ the denoiser's, and relL2 and processor seconds ÷ those of the preset as it is."""
        if not self.frames:
            return "No frame was measured with every variant."
        names, base = [f.name for f in self.frames], VARIANTS[0]
        body = []
        for v in VARIANTS:
            error, worst = self.against(names, v, base, relative_error)
            seconds, _ = self.against(names, v, base, cpu_seconds)
            own = self.mean(names, v, relative_error), self.mean(names, v, cpu_seconds)
            errors = [f"{own[0]:.3f}", f"{error:.3f}", f"{worst[0]:.3f} {worst[1]}"]
            body.append([v.group, v.name, *errors, f"{own[1]:.1f}", f"{seconds:.2f}"])
        errors = ["relL2 ÷ denoiser's", "relL2 ÷ as it is", "its worst frame"]
        return table(["", "variant", *errors, "cpu s", "cpu s ÷ as it is"], body)

    def frame_table(self, table):
        names = [f.name for f in self.asked if self.measured(f.name, VARIANTS[0])]
        body = []
        for v in VARIANTS:
            cells = [self.cell(name, v) for name in names]
            if any(cells):
                body.append([title(v), *("-" if c is None or c.ratio is None else f"{c.ratio:.3f}" for c in cells)])
        return table(["variant", *names], body)

    def skip_table(self, table):
        """Processor seconds and relL2 with each skip over those without, over the frames that have both."""
        body = []
        for pair in PAIRS:
            frames = [self.half_empty.get(f.name) if pair.half_empty else f for f in self.asked]
            names = [f.name for f in frames if f and self.measured(f.name, pair.off) and self.measured(f.name, pair.on)]
            if not names:
                continue
            seconds, slowest = self.against(names, pair.on, pair.off, cpu_seconds)
            error, worst = self.against(names, pair.on, pair.off, relative_error)
            own = [f"{self.mean(names, v, cpu_seconds):.1f}" for v in (pair.off, pair.on)]
            times = [*own, f"{seconds:.2f}", f"{slowest[0]:.2f} {slowest[1]}"]
            body.append([pair.name, len(names), *times, f"{error:.3f}", f"{worst[0]:.3f} {worst[1]}"])
        times = ["cpu s, off", "cpu s, on", "on ÷ off", "its worst frame"]
        headings = ["skip", "frames", *times, "relL2, on ÷ off", "its worst frame"]
        return table(headings, body) if body else "Not measured."

    def markdown(self, head, table):
        names = ", ".join(f.name for f in self.frames)
        parts = [
            f"# Ablations of `{self.preset}`, {self.about['date'][:10]}, commit {self.about['commit']['hash']}",
            *head,
            f"One setting changed at a time. Figures are geometric means over {len(self.frames)} frames ({names}); the "
            "worst frame is the one that the change harms most. cpu s are user and system seconds of the whole "
            "process, all threads; other load affects them less than the wall clock. The rows that repeat the "
            "preset's own size show the scatter.",
            self.table(table),
            "## Every frame (relL2 ÷ the denoiser's)",
            self.frame_table(table),
            "## Skips, off and on",
            "Geometric means over the frames. A background half is zero in every buffer; a frame without features is "
            "run with albedo, normal and visibility set to none.",
            self.skip_table(table),
        ]
        return "\n\n".join(parts) + "\n"

    def json(self):
        pairs = [v for pair in PAIRS for v in (pair.off, pair.on) if v not in VARIANTS]
        variants = [asdict(v) | {"column": column(title(v), self.preset)} for v in (*VARIANTS, *pairs)]
        everything = self.about | {"preset": self.preset, "variants": variants, "results": self.results}
        return json.dumps(everything, indent=1) + "\n"


def relative_error(cell):
    """relL2 over the denoiser's."""
    return cell.ratio


def cpu_seconds(cell):
    return cell.cpu_seconds
