"""Denoises frames with OIDN and writes them: half floats, ZIP, each file complete or absent."""

import os

import numpy as np

# Largest finite half float; radiance above it would be stored as infinity.
HALF_MAX = 65504.0
# Roles whose values are pixels or places, too large for half floats.
SINGLE = ("position", "motion")
CHANNELS = {
    "color": ("R", "G", "B"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
    "visibility": ("visibility.Y",),
    "position": ("position.X", "position.Y", "position.Z"),
    "motion": ("Vector.X", "Vector.Y", "Vector.Z", "Vector.W"),
    "denoised": ("denoised.R", "denoised.G", "denoised.B"),
    "a": ("a.R", "a.G", "a.B"),
    "b": ("b.R", "b.G", "b.B"),
}


def denoised(buffers):
    """OIDN's picture, (height, width, 3): high quality, HDR, with albedo and normal as rendered."""
    from pyoidn import denoise

    planes = (np.ascontiguousarray(buffers[role], dtype=np.float32) for role in ("color", "albedo", "normal"))
    return denoise(*planes, hdr=True, quality="high")


def averaged(a, b):
    """The full buffer of two halves of equally many samples, role by role."""
    return {role: 0.5 * (a[role] + b[role]) for role in a}


def write_frame(folder, spp, a, b):
    """Writes SPPspp.{a,b,denoised}.exr of two half buffers, the full buffer's last: it marks the frame as complete."""
    for name, half in (("a", a), ("b", b)):
        write(folder / f"{spp}spp.{name}.exr", half | {"denoised": denoised(half)})
    write(folder / f"{spp}spp.denoised.exr", {"color": denoised(averaged(a, b))})


def has_frame(folder, spp):
    return all((folder / f"{spp}spp.{name}.exr").is_file() for name in ("a", "b", "denoised"))


def write_reference(folder, a, b, name="ref.exr"):
    """Writes `name`: the mean of two independent references, and both of them, to remove the reference's noise."""
    write(folder / name, {"color": 0.5 * (a + b), "a": a, "b": b})


def write(path, roles, attributes=None):
    """Writes planes of shape (height, width, channels) under the names of `CHANNELS`; `attributes` join the header."""
    import OpenEXR

    channels = {}
    for role, planes in roles.items():
        for index, name in enumerate(CHANNELS[role]):
            plane = planes[..., index]
            kept = (
                plane.astype(np.float32) if role in SINGLE else np.clip(plane, -HALF_MAX, HALF_MAX).astype(np.float16)
            )
            channels[name] = np.ascontiguousarray(kept)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | (attributes or {})
    replace(path, lambda unfinished: OpenEXR.File(header, channels).write(str(unfinished)))


def replace(path, write):
    """Lets `write` fill a temporary file and renames it to `path` when it is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(unfinished)
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
