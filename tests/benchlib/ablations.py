"""Ablations: one preset with one thing changed at a time, as a table of errors and processor seconds."""

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
    *of("training", ("no influence limit", "influence=inf"), ("no gate, no influence limit", "gate=none", "influence=inf")),
    *of("picture", ("mean of halves, not judged", "composition=halves")),
    *(
        Variant("features", name, tuple(word for role in roles for word in ("--role", f"{role}=none")))
        for name, roles in WITHOUT.items()
    ),
    # The preset's own size is among these, whichever it is: its row must equal the first one.
    *of("window", *((f"{side} x {side}", f"window={side}") for side in (7, 11, 15, 19, 25))),
    *of("hidden channels", *((f"{n}", f"hidden={n}") for n in (4, 8, 16))),
    *of("convolutions", *((f"{n}", f"layers={n}") for n in (3, 5, 7, 9))),
]
# Skips pay only where there is something to skip; each of these is a pair on one frame, without and with.
HALF_EMPTY, FEATURELESS = "half-empty", "featureless"
SKIPS = [
    Variant(HALF_EMPTY, "still blocks computed", ("--set", "skip=features")),
    Variant(HALF_EMPTY, "still blocks skipped", ()),
    Variant(FEATURELESS, "absent features computed", (*(w for r in WITHOUT["no feature at all"] for w in ("--role", f"{r}=none")), "--set", "skip=blocks")),
    Variant(FEATURELESS, "absent features skipped", tuple(w for r in WITHOUT["no feature at all"] for w in ("--role", f"{r}=none"))),
]


def chosen(frames):
    """Frames of an ablation: those of the mean, of a shot only the first."""
    first = {}
    for frame in figures.judged(frames):
        first.setdefault(frame.shot or frame.name, frame)
    return list(first.values())


def jobs(frames, half_empty, whole, preset, seeds, steps=None):
    """Every variant on `frames`, the skips on the frame `half_empty` and the featureless `whole` (None: not run)."""
    limit = ("--steps", str(steps)) if steps else ()

    def of_frame(frame, variants):
        methods = [Method(title(v), (preset,), (*v.arguments, *limit)) for v in variants]
        return [Job(frame, method, preset, seed, 0) for seed in seeds for method in methods]

    todo = [job for frame in frames for job in of_frame(frame, VARIANTS)]
    for frame, group in ((half_empty, HALF_EMPTY), (whole, FEATURELESS)):
        if frame:
            todo += of_frame(frame, [v for v in SKIPS if v.group == group])
    return todo


def title(variant):
    return f"{variant.group}: {variant.name}" if variant.group else variant.name


class Ablations:
    """Figures of all variants. `about` as a benchmark's record has it."""

    def __init__(self, about, frames, preset, results):
        self.about, self.preset, self.results = about, preset, results
        self.cells = figures.cells(results)
        # Means are over the frames that every variant has: an interrupted run leaves the last one half done.
        self.frames = [f for f in frames if all(self.measured(f.name, v) for v in VARIANTS)]

    def measured(self, frame, variant):
        cell = self.cell(frame, variant)
        return cell is not None and cell.ratio is not None

    def cell(self, frame, variant):
        return self.cells.get((frame, column(title(variant), self.preset)))

    def mean(self, variant, value):
        """Geometric mean of value(cell) over the frames."""
        return figures.geometric_mean(value(self.cell(f.name, variant)) for f in self.frames)

    def table(self, table):
        """relL2 over the denoiser's and processor seconds of every variant, and both against the preset as it is."""
        if not self.frames:
            return "No frame was measured with every variant."
        base = VARIANTS[0]
        own = [self.mean(base, lambda c: c.ratio), self.mean(base, lambda c: c.cpu_seconds)]
        body = []
        for v in VARIANTS:
            now = [self.mean(v, lambda c: c.ratio), self.mean(v, lambda c: c.cpu_seconds)]
            known = [(self.cell(f.name, v).ratio, f.name) for f in self.frames]
            worst = max(known)
            against = ["-" if not then else f"{100 * (value / then - 1):+.1f} %" for value, then in zip(now, own)]
            body.append([v.group, v.name, f"{now[0]:.3f}", against[0], f"{worst[0]:.3f} {worst[1]}", f"{now[1]:.1f}", against[1]])
        return table(["", "variant", "relL2 ÷ denoiser's", "against as it is", "worst frame", "cpu s", "against as it is"], body)

    def frame_table(self, table):
        names = list(dict.fromkeys(r["frame"] for r in figures.succeeded(self.results) if r["column"] == column(AS_IT_IS, self.preset)))
        body = []
        for v in VARIANTS:
            cells = [self.cell(name, v) for name in names]
            if any(cells):
                body.append([title(v), *("-" if c is None or c.ratio is None else f"{c.ratio:.3f}" for c in cells)])
        return table(["variant", *names], body)

    def skip_table(self, table):
        found = {r["column"]: r["frame"] for r in figures.succeeded(self.results)}
        body = []
        for v in SKIPS:
            frame = found.get(column(title(v), self.preset))
            cell = frame and self.cell(frame, v)
            if cell:
                ratio = "-" if cell.ratio is None else f"{cell.ratio:.3f}"
                body.append([frame, v.name, cell.steps, f"{cell.cpu_seconds:.1f}", f"{cell.seconds:.1f}", ratio])
        return table(["frame", "variant", "steps", "cpu s", "wall s", "relL2 ÷ denoiser's"], body) if body else "Not measured."

    def markdown(self, head, table):
        names = ", ".join(f.name for f in self.frames)
        return "\n\n".join([
            f"# Ablations of `{self.preset}`, {self.about['date'][:10]}, commit {self.about['commit']['hash']}",
            *head,
            f"One thing changed at a time. Figures are geometric means over {len(self.frames)} frames ({names}); cpu s are user and system seconds of "
            "the whole process, all threads: they depend less on what else the machine does than the wall clock.",
            self.table(table),
            "## Every frame (relL2 ÷ the denoiser's)\n\n" + self.frame_table(table),
            "## Skips, on and off\n\nThe right half of the half-empty frame is zeros in every buffer; the featureless one is told to have no albedo, "
            "normal or visibility.\n\n" + self.skip_table(table),
        ]) + "\n"

    def json(self):
        variants = [asdict(v) | {"column": column(title(v), self.preset)} for v in (*VARIANTS, *SKIPS)]
        return json.dumps(self.about | {"preset": self.preset, "variants": variants, "results": self.results}, indent=1) + "\n"
