"""Equal time: render and denoise more samples, or fewer samples, denoise them three times and correct.

Corrected frames need both halves and the full buffer denoised; the denoiser alone needs one. Errors of sample counts
between those measured are interpolated in log-log (`Ladder`).
"""

from dataclasses import dataclass

from ..equal_time import Ladder


@dataclass(frozen=True)
class Equal:
    """One row: a corrected frame, and what its time buys without correction."""

    denoiser: str
    spp: int
    # Processor seconds of render, three denoised pictures and the fit.
    seconds: float
    corrected: float
    # Samples that render and one denoised picture give in that time, and the denoiser's relL2 there.
    other_spp: float
    denoised: float | None
    # Outside the sample counts that were measured.
    extrapolated: bool


def rows(found, seconds):
    """`found`: {denoiser: {spp: figures}}; `seconds`: see `frames`."""
    out = []
    for denoiser, figures in found.items():
        ladder = Ladder(tuple(sorted((spp, f["denoised"]) for spp, f in figures.items())), None)
        for spp, f in sorted(figures.items()):
            render, z = seconds["render"][str(spp)], seconds["denoise"][str(spp)][denoiser]
            total = render + 3 * z + f["seconds"]
            other = spp * max(total - z, 0.0) / render
            inside = ladder.steps[0][0] <= other <= ladder.steps[-1][0]
            out.append(Equal(denoiser, spp, total, f["corrected"], other, ladder.error_at(other), not inside))
    return out
