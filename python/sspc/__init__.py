"""Self-supervised post-correction of denoised Monte Carlo renders, on arrays in memory.

    model = sspc.fit(a, b, denoised_a=za, denoised_b=zb, denoised=z, albedo_a=..., albedo_b=...)
    result = model.correct(a, b, denoised_a=za, denoised_b=zb, denoised=z, albedo_a=..., albedo_b=...)
    result.picture, result.share, result.estimate, result.report

a and b are two half buffers of one picture, rendered with different seeds; each has what a denoiser made of it alone,
and the correction is added to `denoised`, the denoiser's picture of both halves together. Arrays have the shape
(height, width, channels), linear RGB in float32 or float16, by the buffer protocol or DLPack: NumPy, PyTorch (CPU),
Mitsuba and others. Pictures are those of the programs `sspc-train` and `sspc-infer`, bit for bit.

Both functions work on all cores with the GIL released; RAYON_NUM_THREADS, set before the first call, changes how many.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, NamedTuple, TypeVar

from . import _native
from ._arrays import ARGUMENTS, INPUT, Reader, like
from ._errors import Error, FrameWarning
from ._native import Step

__all__ = [
    "Comparison",
    "Error",
    "Estimate",
    "Evaluation",
    "Figures",
    "FrameWarning",
    "Mean",
    "Model",
    "Result",
    "Step",
    "evaluate",
    "fit",
]

Array = TypeVar("Array")

Preset = Literal["fast", "balanced", "quality", "paper"]

_Denoised = tuple[bytes, bytes, bytes | None]
# Height, width, the bytes of arrays by name, those of `denoised_more`, and the samples of both halves.
_Frame = tuple[int, int, dict[str, bytes], list[_Denoised], tuple[float, float] | None]

_REQUIRED = {"a", "b", "denoised_a", "denoised_b"}
_CHANNELS = {"visibility_a": 1, "visibility_b": 1}


class Mean(NamedTuple):
    """A mean over the picture; its standard error is None where there are too few pixels to tell."""

    value: float
    standard_error: float | None


class Estimate(NamedTuple):
    """relL2 of the mean of both halves, estimated without a reference: the denoiser's, the corrected, and the gain."""

    denoised: Mean
    corrected: Mean
    gain: Mean


@dataclass(frozen=True)
class Result(Generic[Array]):
    """A corrected picture and what it says of itself."""

    picture: Array
    """Linear RGB, (height, width, 3), float32, in the units of the frame."""
    share: Array
    """Share of the correction that was used at each pixel, 0..1, (height, width), float32."""
    estimate: Estimate
    """How large the error is, estimated from the halves."""
    report: dict[str, Any]
    """Every figure, by the keys of `sspc-infer run --json`."""

    @property
    def fallback(self) -> str | None:
        """Why the picture is the denoiser's, bit for bit, if it is."""
        reason: str | None = self.report["fallback"]
        return reason


def fit(
    a: Array,
    b: Array,
    *,
    denoised_a: Array,
    denoised_b: Array,
    denoised: Array | None = None,
    denoised_more: Sequence[Sequence[Array | None]] = (),
    albedo_a: Array | None = None,
    albedo_b: Array | None = None,
    normal_a: Array | None = None,
    normal_b: Array | None = None,
    visibility_a: Array | None = None,
    visibility_b: Array | None = None,
    dx_a: Array | None = None,
    dx_b: Array | None = None,
    dy_a: Array | None = None,
    dy_b: Array | None = None,
    samples: tuple[float, float] | None = None,
    preset: Preset = "balanced",
    seed: int = 1,
    steps: int | None = None,
    time_limit: float | None = None,
    settings: Mapping[str, object] | None = None,
    init: Model | None = None,
    progress: Callable[[Step], object] | None = None,
) -> Model:
    """Fits a model to one frame, as `sspc-train fit` does.

    Radiance `a`, `b` and the denoised pictures are (height, width, 3), albedo 0..1 and normal -1..1 too; visibility is
    (height, width) or (height, width, 1), 0..1. Without `denoised`, the mean of both denoised halves is corrected.
    `denoised_more` holds further pictures that denoisers made of the same halves, each as (half a, half b) or (half a,
    half b, full buffer), as `--denoised-more` does: a network is fitted on each. `dx_a` to `dy_b` are a gradient-domain
    renderer's differences to the pixel on the right and below, (height, width, 3), which `settings={"differences": 1}`
    trains on. `samples` are the samples per pixel of
    half a and half b, where they differ: what each weighs in means of both, as `--samples-a` and `--samples-b` say.
    `settings` changes single settings of the preset, as `--set` does. `init` is a model to start from, e.g. that of the
    previous frame. `progress` is called after every step; what it raises stops the fit and comes through, and so does
    KeyboardInterrupt.

    Raises `Error`; warns of what a person should know by `FrameWarning`.
    """
    frame = _frame(
        denoised_more,
        samples,
        a=a,
        b=b,
        denoised_a=denoised_a,
        denoised_b=denoised_b,
        denoised=denoised,
        albedo_a=albedo_a,
        albedo_b=albedo_b,
        normal_a=normal_a,
        normal_b=normal_b,
        visibility_a=visibility_a,
        visibility_b=visibility_b,
        dx_a=dx_a,
        dx_b=dx_b,
        dy_a=dy_a,
        dy_b=dy_b,
    )
    model = Model(
        _native.fit(
            frame,
            preset=preset,
            seed=seed,
            steps=steps,
            time_limit=time_limit,
            changes=[f"{key}={value}" for key, value in (settings or {}).items()],
            init=None if init is None else init._native,
            progress=progress,
        )
    )
    _warn(model.report["warnings"] if model.report else [])
    return model


class Model:
    """A fitted model: what `model.onnx` holds. Made by `fit` or `Model.load`."""

    def __init__(self, native: _native.Model) -> None:
        self._native = native

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Model:
        """Reads a model that `save`, `sspc-train fit` or `sspc-train export` wrote. Raises `Error`."""
        return cls(_native.Model.load(os.fspath(path)))

    def save(self, path: str | os.PathLike[str], graph: Literal["network", "image"] = "network") -> None:
        """Writes the model as ONNX: the network, or the whole corrector in standard operators; both can be loaded.

        The file appears whole or not at all. Raises `Error`.
        """
        self._native.save(os.fspath(path), graph)

    def correct(
        self,
        a: Array,
        b: Array,
        *,
        denoised_a: Array,
        denoised_b: Array,
        denoised: Array | None = None,
        denoised_more: Sequence[Sequence[Array | None]] = (),
        albedo_a: Array | None = None,
        albedo_b: Array | None = None,
        normal_a: Array | None = None,
        normal_b: Array | None = None,
        visibility_a: Array | None = None,
        visibility_b: Array | None = None,
        dx_a: Array | None = None,
        dx_b: Array | None = None,
        dy_a: Array | None = None,
        dy_b: Array | None = None,
        samples: tuple[float, float] | None = None,
        strength: float = 1.0,
    ) -> Result[Array]:
        """Corrects a frame, as `sspc-infer run` does: the one that the model was fitted to, or another of the shot.

        Arrays are as for `fit`, `denoised_more` with as many as there; `strength` is the share of the correction that
        is added to the denoiser's picture. The results are arrays of the kind that `a` is, where it can be told, else
        NumPy's.

        Raises `Error`; warns of what a person should know by `FrameWarning`.
        """
        frame = _frame(
            denoised_more,
            samples,
            a=a,
            b=b,
            denoised_a=denoised_a,
            denoised_b=denoised_b,
            denoised=denoised,
            albedo_a=albedo_a,
            albedo_b=albedo_b,
            normal_a=normal_a,
            normal_b=normal_b,
            visibility_a=visibility_a,
            visibility_b=visibility_b,
            dx_a=dx_a,
            dx_b=dx_b,
            dy_a=dy_a,
            dy_b=dy_b,
        )
        picture, share, text = self._native.correct(frame, strength)
        report = json.loads(text)
        _warn([*report["warnings"], *filter(None, [report["unlike"]])])
        height, width, *_ = frame
        means = {key: Mean(mean["value"], mean["standard_error"]) for key, mean in report["estimate"].items()}
        return Result(
            picture=like(a, picture, (height, width, 3)),
            share=like(a, share, (height, width)),
            estimate=Estimate(**means),
            report=report,
        )

    @property
    def report(self) -> dict[str, Any] | None:
        """Every figure and setting of the fit, by the keys of `report.json`; None of a model that was loaded."""
        text = self._native.report
        return None if text is None else json.loads(text)

    @property
    def preset(self) -> str:
        """The preset of the fit."""
        return self._native.preset

    @property
    def seed(self) -> int:
        """The seed of the fit."""
        return self._native.seed

    @property
    def steps(self) -> int:
        """Steps that the fit took."""
        return self._native.steps

    @property
    def features(self) -> tuple[str, ...]:
        """Features that it was fitted with, of albedo, normal and visibility."""
        return tuple(self._native.features)

    def __repr__(self) -> str:
        features = ", ".join(self.features) or "no features"
        return f"<sspc.Model: preset {self.preset}, {self.steps} steps, seed {self.seed}, {features}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (self._native.to_bytes(), self._native.report)


def _unpickled(model: bytes, report: str | None) -> Model:
    return Model(_native.Model.from_bytes(model, report))


class Figures(NamedTuple):
    """Errors of a picture against its reference, as `sspc-infer evaluate` has them."""

    rel_l2: float
    """Without the reference's own noise where its halves were given."""
    rel_l2_standard_error: float
    brightness: float
    """Mean radiance over that of the reference."""
    smape: float
    psnr: float
    """dB, of the displayed picture; infinite for equal pictures."""
    ssim: float
    flip: float
    pixels: int
    excluded: int
    """Pixels left out because they are NaN or infinite."""


class Comparison(NamedTuple):
    """The denoiser's figures, and what the picture's are of them."""

    figures: Figures
    rel_l2_ratio: float
    crossed_ratio: float
    """The same across the reference's halves, free of its noise; NaN without halves."""
    crossed_ratio_standard_error: float


class Evaluation(NamedTuple):
    """A picture against a reference, and the denoiser's beside it where it was given."""

    figures: Figures
    denoised: Comparison | None
    exposure: float
    """Factor on radiance before the display curve of PSNR, SSIM and FLIP."""


def evaluate(
    picture: Any,
    reference: Any,
    *,
    reference_a: Any = None,
    reference_b: Any = None,
    denoised: Any = None,
    exposure: float | None = None,
) -> Evaluation:
    """Measures a picture against a reference, as `sspc-infer evaluate` does; all (height, width, 3).

    `reference_a` and `reference_b` are the reference's two independent halves: with them its own noise is taken out of
    relL2. The default `exposure` puts the geometric mean of the reference's luminance at middle grey. Raises `Error`.
    """
    reader = Reader()
    given = {"picture": picture, "reference": reference}
    optional = {"reference_a": reference_a, "reference_b": reference_b, "denoised": denoised}
    given |= {name: value for name, value in optional.items() if value is not None}
    arrays = {name: reader.read(name, value, 3) for name, value in given.items()}
    if ("reference_a" in arrays) != ("reference_b" in arrays):
        raise Error("reference_a, reference_b: expected both or neither, found one", "give both halves", ARGUMENTS)
    halves = (arrays["reference_a"], arrays["reference_b"]) if "reference_a" in arrays else None
    used, own, beside = _native.evaluate(
        reader.size or (0, 0),
        picture=arrays["picture"],
        reference=arrays["reference"],
        halves=halves,
        denoised=arrays.get("denoised"),
        exposure=exposure,
    )
    comparison = None if beside is None else Comparison(Figures(*beside[0]), *beside[1:])
    return Evaluation(Figures(*own), comparison, used)


def _frame(more: Any, samples: Any, **roles: Any) -> _Frame:
    """What the extension takes; every array that was given, by its argument's name."""
    reader = Reader()
    given = {name: value for name, value in roles.items() if value is not None or name in _REQUIRED}
    arrays = {name: reader.read(name, value, _CHANNELS.get(name, 3)) for name, value in given.items()}
    further = [_denoised(reader, f"denoised_more[{at}]", pictures) for at, pictures in enumerate(more)]
    height, width = reader.size or (0, 0)
    return height, width, arrays, further, _samples(samples)


def _denoised(reader: Reader, name: str, pictures: Any) -> _Denoised:
    """The bytes of one further denoised picture: of half a, half b, and the full buffer where it is there."""
    found = len(pictures) if isinstance(pictures, (tuple, list)) else None
    if found not in (2, 3):
        what = type(pictures).__name__ if found is None else f"{found} arrays"
        advice = "give denoised_more=[(za, zb, z), ...]"
        raise Error(f"{name}: expected (half a, half b) or (half a, half b, full buffer), found {what}", advice, INPUT)
    a, b, full = (*pictures, None)[:3]
    halves = (reader.read(f"{name}[0]", a, 3), reader.read(f"{name}[1]", b, 3))
    return (*halves, None if full is None else reader.read(f"{name}[2]", full, 3))


def _samples(samples: Any) -> tuple[float, float] | None:
    if samples is None:
        return None
    try:
        a, b = (float(count) for count in samples)
    except (TypeError, ValueError):
        advice = "give samples=(32, 8), the samples per pixel of each half"
        raise Error(f"samples: expected two numbers, found {samples!r}", advice, ARGUMENTS) from None
    return a, b


def _warn(texts: list[str]) -> None:
    """Warns in the name of whoever called `fit` or `correct`."""
    for text in texts:
        warnings.warn(text, FrameWarning, stacklevel=3)
