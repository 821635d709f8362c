"""Arrays of any framework to bytes, and results back to the framework that the arrays came from."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from ._errors import Error

ARGUMENTS = 2
"""Exit code of the programs for arguments that make no sense."""

INPUT = 3
"""Exit code of the programs for an input that is not what it should be."""


class Reader:
    """Takes arrays of one size, each as little-endian float32 of shape (height, width, channels)."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None
        self._like = ""

    def read(self, name: str, value: Any, channels: int) -> bytes:
        """The bytes of an array, whose argument is called `name`."""
        array = _as_numpy(name, value)
        if array.dtype.kind != "f" or array.dtype.itemsize not in (2, 4):
            advice = "convert it, e.g. with .astype('float32')"
            raise Error(f"{name}: expected float32 or float16, found {array.dtype}", advice, INPUT)
        if channels == 1 and array.ndim == 2:
            array = array[..., np.newaxis]
        if array.ndim != 3 or array.shape[2] != channels or 0 in array.shape:
            expected = f"(height, width, {channels})" + (" or (height, width)" if channels == 1 else "")
            advice = "slice the channels, e.g. x[..., :3], and move them last, e.g. x.transpose(1, 2, 0)"
            raise Error(f"{name}: expected an array of shape {expected}, found {array.shape}", advice, INPUT)
        height, width = array.shape[:2]
        if self.size is None:
            self.size, self._like = (height, width), name
        elif self.size != (height, width):
            expected = f"{self.size[1]} x {self.size[0]} pixels as in {self._like}"
            advice = "give all arrays of a frame in one resolution"
            raise Error(f"{name}: expected {expected}, found {width} x {height}", advice, INPUT)
        return array.astype("<f4", copy=False).tobytes()


def _as_numpy(name: str, value: Any) -> np.ndarray[Any, Any]:
    """A view of the values: by the buffer protocol, NumPy's array interface, or DLPack."""
    if isinstance(value, np.ndarray):
        return value
    try:
        if hasattr(value, "__array_interface__"):
            return np.asarray(value)
        if hasattr(value, "__dlpack__"):
            return np.asarray(np.from_dlpack(value))
        return np.asarray(memoryview(value))
    except TypeError as error:
        found = f"found {type(value).__name__}"
        advice = "give an array with the buffer protocol or DLPack: NumPy, PyTorch, Mitsuba, ..."
        raise Error(f"{name}: expected an array, {found}", advice, INPUT) from error
    except (BufferError, RuntimeError, ValueError) as error:
        advice = "give float32 or float16 in the memory of the CPU, without a gradient to track"
        raise Error(f"{name}: its values cannot be had: {error}", advice, INPUT) from error


def like(value: Any, data: bytearray, shape: tuple[int, ...]) -> Any:
    """The bytes of a result as an array of the framework that `value` is of; NumPy's where it cannot be told."""
    result = np.frombuffer(data, dtype="<f4").reshape(shape)
    framework = type(value).__module__.partition(".")[0]
    if framework == "torch":
        return sys.modules["torch"].from_numpy(result)
    if framework in ("drjit", "mitsuba"):
        return type(value)(result)
    if isinstance(value, memoryview):
        return result.data
    if not isinstance(value, np.ndarray) and hasattr(value, "__array_namespace__"):
        return value.__array_namespace__().asarray(result)
    return result
