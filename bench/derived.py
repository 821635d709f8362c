"""Frames derived from other frames by the example edit_exr: enlarged, half empty, quarters."""

import dataclasses
import struct
import subprocess
from pathlib import Path

# The scene that derived frames are made of, where it is among those measured.
BEST_SOURCE = "living-room/64spp"


class NoTool(Exception):
    """edit_exr is missing or failed."""


def source(frames):
    """The frame to derive from: an ordinary one, as denoised; None without any."""
    plain = [frame for frame in frames if frame.reference and frame.variant is None]
    named = [frame for frame in plain if frame.name == BEST_SOURCE]
    return (named or plain or [None])[0]


def fourfold(frame, tool, folder):
    """Two by two mirrored copies of a frame, for timing only: the error of a copy is no new information."""
    copy = made(frame, tool, folder, "2x2", lambda path: ("mirror", *(str(2 * side) for side in size(path))))
    return dataclasses.replace(copy, reference=None, shot=None)


def half_empty(frame, tool, folder):
    """The frame with zeros in the right half of every buffer: background."""

    def blank(path):
        width, height = size(path)
        return ("blank", str(width // 2), "0", str(width - width // 2), str(height))

    return made(frame, tool, folder, "half-empty", blank)


def quarter(frame, tool, folder, index):
    """The `index`-th quarter of a frame, 0 to 3, as its own frame."""

    def crop(path):
        width, height = size(path)
        row, column = divmod(index, 2)
        left, top = column * (width // 2), row * (height // 2)
        right, bottom = (width if column else width // 2), (height if row else height // 2)
        return ("crop", *map(str, (left, top, right - left, bottom - top)))

    return dataclasses.replace(made(frame, tool, folder, f"quarter-{index + 1}", crop), variant=frame.variant)


def made(frame, tool, folder, name, arguments):
    """The frame with every file edited; `arguments` maps a file to edit_exr's verb and numbers."""
    if not tool.is_file():
        raise NoTool(f"no {tool.name} beside the programs: run `cargo build --release --workspace --bins --examples`")
    place = Path(folder) / f"{frame.name}-{name}".replace("/", "-")
    place.mkdir(parents=True, exist_ok=True)
    files = {}
    for role in ("a", "b", "denoised", "denoised_a", "denoised_b", "reference"):
        path = getattr(frame, role)
        if path is None:
            continue
        files[role] = place / f"{role}.exr"
        verb, *numbers = arguments(path)
        done = subprocess.run([tool, verb, path, files[role], *numbers], capture_output=True, text=True)
        if done.returncode:
            raise NoTool(f"{tool.name} {verb} {path}: {done.stderr.strip()}")
    return dataclasses.replace(frame, name=f"{frame.name}/{name}", variant=name, **files)


def mirror(tool, source, target, width, height):
    """Writes `target`, mirrored copies of `source`. Its noise repeats: measure time and memory on it, not quality."""
    subprocess.run([tool, "mirror", source, target, str(width), str(height)], check=True)


def size(path):
    """Width and height of the data window of an OpenEXR file's first part; raises NoTool where there is none."""
    with open(path, "rb") as file:
        if file.read(4) != b"\x76\x2f\x31\x01":
            raise NoTool(f"{path} is not an OpenEXR file")
        file.read(4)
        while (name := text(file)) != "":
            text(file)
            value = file.read(struct.unpack("<i", file.read(4))[0])
            if name == "dataWindow":
                left, top, right, bottom = struct.unpack("<4i", value)
                return right - left + 1, bottom - top + 1
    raise NoTool(f"{path} has no data window")


def text(file):
    """A zero-terminated string."""
    letters = bytearray()
    while (letter := file.read(1)) not in (b"\0", b""):
        letters += letter
    return letters.decode("latin-1")
