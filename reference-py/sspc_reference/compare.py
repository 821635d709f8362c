"""The first stage at which two runs of the method differ.

A run is a set of arrays named after the pipeline's stages. Shared stages are compared in the order below; stages that
only one run has are reported.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from .features import COUNT
from .network import HIDDEN_CHANNELS, HIDDEN_LAYERS

# In the order of the data; gradients in the order of the backward pass. Each with the largest
# difference, relative to the stage's largest value, that rounding to float32 explains.
FORWARD = 1e-5  # nine layers, 361 weights: a few dozen roundings of 6e-8 each
LOSS = 1e-6  # one mean of positive terms
GRADIENT = 1e-4  # sums of terms of both signs
STAGES = {
    "features": 0.0,  # copied, never computed
    **{f"layer_{layer}": FORWARD for layer in range(1, 10)},
    "parameters": FORWARD,
    "g": FORWARD,
    "mu_hat": FORWARD,
    "loss": LOSS,
    "d_mu_hat": GRADIENT,
    "d_g": GRADIENT,
    "d_parameters": GRADIENT,
    "d_raw": GRADIENT,
    "d_weights": GRADIENT,
}


@dataclass
class Report:
    differs: bool
    text: str
    # |found - expected| of the first differing stage; None where none differs.
    error: np.ndarray | None = None


def first_difference(expected, found):
    """Compares two mappings of stage name to array and reports the first stage that differs."""
    lines = []
    for stage, tolerance in STAGES.items():
        if stage not in expected or stage not in found:
            if stage in expected or stage in found:
                lines.append(f"{stage}: in one run only, not compared")
            continue
        e, f = np.asarray(expected[stage]), np.asarray(found[stage])
        if e.shape != f.shape:
            lines.append(f"{stage}: FIRST DIFFERENCE, shape expected {e.shape}, found {f.shape}")
            return Report(True, "\n".join(lines))
        error = np.abs(f.astype(np.float64) - e)
        scale = np.abs(e).max(initial=0.0)
        allowed = tolerance * scale
        bad = ~(error <= allowed)  # NaN is bad
        if bad.any():
            name = f"{stage} of layer {layer_of(bad)}" if stage == "d_weights" else stage
            lines.append(f"{name}: FIRST DIFFERENCE, {describe(e, f, error, bad, allowed)}")
            return Report(True, "\n".join(lines), error)
        worst = error.max(initial=0.0) / scale if scale else 0.0
        lines.append(f"{stage}: equal, worst {worst:.1e} of the largest value (<= {tolerance:.0e})")
    if not any("equal" in line for line in lines):
        raise ValueError("the two files share no stage")
    return Report(False, "\n".join(lines))


def layer_of(bad):
    """The last layer with a bad weight, which the backward pass reaches first."""
    last = int(np.flatnonzero(bad)[-1])
    first_layer = HIDDEN_CHANNELS * (COUNT * 9 + 1)
    hidden_layer = HIDDEN_CHANNELS * (HIDDEN_CHANNELS * 9 + 1)
    if last < first_layer:
        return 1
    return min(2 + (last - first_layer) // hidden_layer, HIDDEN_LAYERS + 1)


def describe(expected, found, error, bad, allowed):
    """How many values differ, the first and the worst."""
    first = tuple(int(i) for i in np.argwhere(bad)[0])
    ranked = np.where(np.isnan(error), np.inf, error)
    worst = tuple(int(i) for i in np.unravel_index(ranked.argmax(), error.shape))
    return (
        f"{int(bad.sum())} of {error.size} values by more than {allowed:.1e}; "
        f"first at {first}: expected {expected[first]:.9g}, found {found[first]:.9g}; "
        f"worst at {worst}: expected {expected[worst]:.9g}, found {found[worst]:.9g}"
    )


def write_error_map(path, error):
    """Writes the largest error over the channels of [.., H, W] as a grey PNG, white = the worst."""
    error = np.nan_to_num(np.atleast_2d(error), nan=np.inf)
    plane = error.reshape(-1, *error.shape[-2:]).max(axis=0)
    finite = plane[np.isfinite(plane)]
    top = finite.max(initial=0.0)
    grey = np.where(np.isfinite(plane), plane / top if top > 0 else 0.0, 1.0)
    write_grey_png(path, (grey * 255).round().astype(np.uint8))


def write_grey_png(path, pixels):
    """An 8-bit grey PNG of [H, W]."""
    height, width = pixels.shape

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        file.write(chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)))
        file.write(chunk(b"IDAT", zlib.compress(rows)))
        file.write(chunk(b"IEND", b""))
