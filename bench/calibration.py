"""Estimated against true error: coverage of the standard errors, and the points of the plot."""

from dataclasses import dataclass
from statistics import median

# In the order of the table.
DENOISED, CORRECTED, GAIN = (
    "error of the denoised picture",
    "error of the corrected picture",
    "gain (denoised less corrected)",
)
WHATS = (DENOISED, CORRECTED, GAIN)


@dataclass(frozen=True)
class Prediction:
    frame: str
    column: str
    what: str
    predicted: float
    # None where the fit reports none.
    standard_error: float | None
    truth: float

    def within(self, errors):
        """Whether the truth lies within so many standard errors; None where there is none."""
        if self.standard_error is None:
            return None
        return abs(self.truth - self.predicted) <= errors * self.standard_error


def predictions(results):
    """Predictions of every successful result with an estimate and a reference.

    An estimate concerns the mean of both halves, and so does its truth (`halves`; frames with missing pixels have
    none). The estimate of the denoised picture hardly depends on seed or preset and is taken once per frame.
    """
    out, seen = [], set()
    for result in results:
        truth, estimate = (result.get("rel_l2") or {}).get("halves"), (result.get("report") or {}).get("estimate")
        if result["failure"] or not truth or not estimate or result["repeat"] > 0:
            continue
        truth = truth | {"gain": truth["denoised"] - truth["corrected"]}
        for what, key in zip(WHATS, ("denoised", "corrected", "gain")):
            if what != DENOISED or result["frame"] not in seen:
                value, error = estimate[key]["value"], estimate[key]["standard_error"]
                out.append(Prediction(result["frame"], result["column"], what, value, error, truth[key]))
        seen.add(result["frame"])
    return out


@dataclass(frozen=True)
class Coverage:
    """Figures of all predictions of one kind."""

    count: int
    # Fractions of those with a standard error; None without any.
    within_one: float | None
    within_two: float | None
    # Median of predicted over true.
    ratio: float
    # Predictions that are 0 or below; for the gain, those whose sign is not the truth's.
    not_positive: int
    wrong_sign: int


def coverage(predictions):
    """Raises ValueError without any prediction."""
    if not predictions:
        raise ValueError("no prediction")
    told = [p for p in predictions if p.standard_error is not None]

    def share(errors):
        return sum(p.within(errors) for p in told) / len(told) if told else None

    return Coverage(
        len(predictions),
        share(1),
        share(2),
        median(p.predicted / p.truth for p in predictions),
        sum(p.predicted <= 0 for p in predictions),
        sum((p.predicted > 0) != (p.truth > 0) for p in predictions),
    )


NOTE = (
    "Predictions are `estimate` of report.json, made without the reference; the truth is relL2 of the same pictures "
    "(means of both halves) by the reference. Complete standard errors would cover the truth in 68 % and 95 % of the "
    "cases; frames of one shot, and presets on one frame, are not independent."
)


def text(results, table, picture):
    """The section's text; `table` makes a Markdown table, `picture` is the plot's file name."""
    found = predictions(results)
    if not found:
        return "No run with a reference reported an estimate."
    headings = ["prediction", "cases", "truth within 1 s.e.", "within 2 s.e.", "predicted ÷ true, median"]
    headings += ["predicted ≤ 0", "wrong sign"]
    body = []
    for what in WHATS:
        of = [p for p in found if p.what == what]
        if of:
            c = coverage(of)
            covered = [percent(c.within_one), percent(c.within_two)]
            body.append([what, c.count, *covered, f"{c.ratio:.2f}", c.not_positive, c.wrong_sign])
    image = f"![predicted against true relL2]({picture})\n\n" if picture else ""
    return f"{image}{NOTE}\n\n{table(headings, body)}"


def percent(share):
    return "-" if share is None else f"{100 * share:.0f} %"
