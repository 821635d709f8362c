# What the extension module gives to the package; users call `sspc`.

from collections.abc import Callable

# Height, width, arrays by name, and further denoised pictures; dictionary and list are emptied by whoever takes them.
_Frame = tuple[int, int, dict[str, bytes], list[tuple[bytes, bytes, bytes | None]], tuple[float, float] | None]
_Figures = tuple[float, float, float, float, float, float, float, int, int]

class Step:
    """One step of training, as told to the callback."""

    @property
    def step(self) -> int:
        """From 1."""

    @property
    def of(self) -> int:
        """Steps that are planned."""

    @property
    def loss(self) -> float:
        """Mean loss of the step's tiles."""

    @property
    def rate(self) -> float:
        """Learning rate."""

    @property
    def seconds(self) -> float:
        """Seconds since training began."""

class Model:
    @staticmethod
    def load(path: str) -> Model: ...
    @staticmethod
    def from_bytes(bytes: bytes, report: str | None) -> Model: ...
    def to_bytes(self) -> bytes: ...
    def save(self, path: str, graph: str) -> None: ...
    def correct(self, frame: _Frame, strength: float) -> tuple[bytearray, bytearray, str]: ...
    @property
    def report(self) -> str | None: ...
    @property
    def preset(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def features(self) -> list[str]: ...

def fit(
    frame: _Frame,
    *,
    preset: str,
    seed: int,
    steps: int | None,
    time_limit: float | None,
    changes: list[str],
    init: Model | None,
    progress: Callable[[Step], object] | None,
) -> Model: ...
def evaluate(
    size: tuple[int, int],
    *,
    picture: bytes,
    reference: bytes,
    halves: tuple[bytes, bytes] | None,
    denoised: bytes | None,
    exposure: float | None,
) -> tuple[float, _Figures, tuple[_Figures, float, float, float] | None]: ...
