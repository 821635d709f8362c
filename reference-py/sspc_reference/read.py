"""Reads a frame: two EXR files with one half of the samples each.

Each file holds R, G, B (noisy), denoised.R, G, B, and, where the renderer wrote them,
albedo.R, G, B, normal.X, Y, Z and visibility.Y. Only the Rust reader handles other layouts.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
import torch

from . import features
from .features import BadInput

CHANNEL_NAMES = {
    "radiance": ["R", "G", "B"],
    "denoised": ["denoised.R", "denoised.G", "denoised.B"],
    "albedo": ["albedo.R", "albedo.G", "albedo.B"],
    "normal": ["normal.X", "normal.Y", "normal.Z"],
    "visibility": ["visibility.Y"],
}
OPTIONAL = ("albedo", "normal", "visibility")


@dataclass
class Frame:
    """Both halves' features [1, 13, H, W], and the denoised full buffer [1, 3, H, W] or None."""

    a: torch.Tensor
    b: torch.Tensor
    denoised: torch.Tensor | None
    # Roles that the files lack; their planes are zero.
    absent: list[str]

    def scaled(self, scale):
        """The frame with its colours (radiance and denoised) multiplied by `scale`."""

        def colours(half):
            half = half.clone()
            half[:, features.CHANNELS["radiance"]] *= scale
            half[:, features.CHANNELS["denoised"]] *= scale
            return half

        denoised = None if self.denoised is None else self.denoised * scale
        return Frame(colours(self.a), colours(self.b), denoised, self.absent)


def read_channels(path):
    """All channels of all parts of an EXR file: name -> float32 [H, W]."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    channels = {}
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in range(len(file.parts)):
            for name, channel in file.channels(part).items():
                channels[name] = np.array(channel.pixels, dtype=np.float32)
    return channels


def read_image(path, names, channels=None):
    """The named channels of a file as [1, C, H, W] float32."""
    channels = read_channels(path) if channels is None else channels
    missing = [name for name in names if name not in channels]
    if missing:
        found = ", ".join(sorted(channels))
        raise BadInput(f"{path}: no channel {missing[0]}; it has {found}")
    return torch.from_numpy(np.stack([channels[name] for name in names]))[None]


def read_half(path):
    """One half's features [1, 13, H, W], and the optional roles it lacks."""
    channels = read_channels(path)
    images, absent = {}, []
    for role, names in CHANNEL_NAMES.items():
        if role in OPTIONAL and not any(name in channels for name in names):
            absent.append(role)
            continue
        images[role] = read_image(path, names, channels)
    try:
        return features.assemble(**images), absent
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None


def read_frame(path_a, path_b, path_denoised=None):
    """Both halves, and the denoised full buffer (R, G, B) if a path is given."""
    a, absent_a = read_half(path_a)
    b, absent_b = read_half(path_b)
    if a.shape != b.shape:
        raise BadInput(f"{path_b}: expected {a.shape[2]}x{a.shape[3]} as {path_a}, found {b.shape[2]}x{b.shape[3]}")
    if absent_a != absent_b:
        raise BadInput(f"{path_b}: lacks {absent_b}, but {path_a} lacks {absent_a}")
    if torch.equal(a, b):
        raise BadInput(f"{path_b}: identical to {path_a}; the halves must be independent")
    denoised = None
    if path_denoised is not None:
        denoised = read_image(path_denoised, CHANNEL_NAMES["radiance"]).clamp_min(0)
        if denoised.shape[2:] != a.shape[2:]:
            raise BadInput(
                f"{path_denoised}: expected {a.shape[2]}x{a.shape[3]} as {path_a}, "
                f"found {denoised.shape[2]}x{denoised.shape[3]}"
            )
    return Frame(a, b, denoised, absent_a)


def read_reference(path):
    """A reference and, if the file has them, its two halves: [1, 3, H, W] each, or (mean, None)."""
    channels = read_channels(path)
    mean = read_image(path, ["R", "G", "B"], channels)
    if "a.R" not in channels:
        return mean, None
    halves = [read_image(path, [f"{half}.{colour}" for colour in "RGB"], channels) for half in "ab"]
    return mean, halves


def write_image(path, image):
    """Writes [1, 3, H, W] or [3, H, W] as R, G, B floats."""
    planes = image.detach().reshape(3, *image.shape[-2:]).to(torch.float32).numpy()
    channels = {name: np.ascontiguousarray(plane) for name, plane in zip("RGB", planes)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
