"""Channels of OpenEXR files, read and written exactly: scan lines, ZIP or uncompressed.

Blender gives scripts no passes of a file, and saves images through its colour management.
"""

import struct
import zlib

import numpy as np

MAGIC = 20000630
MULTIPART, UNREADABLE = 0x1000, 0x200 | 0x800
TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
ZIP = 3
# Lines of a chunk for the compressions none, ZIPS and ZIP.
LINES = {0: 1, 2: 1, ZIP: 16}


class Unreadable(Exception):
    """Another kind of OpenEXR file, or a damaged one."""


class Missing(Unreadable):
    """No part of the file has these channels."""


def read(path, names):
    """The channels `names` as float32 of shape (height, width, len(names)), the top row first."""
    with open(path, "rb") as file:
        data = file.read()
    try:
        return decode(memoryview(data), list(names))
    except (struct.error, IndexError, KeyError, ValueError, zlib.error) as error:
        raise Unreadable(f"{path}: {error!r}") from error


def decode(data, names):
    magic, version = struct.unpack_from("<II", data)
    if magic != MAGIC or version & UNREADABLE:
        raise ValueError("not an OpenEXR file of flat scan lines")
    multipart = bool(version & MULTIPART)
    parts, at = headers(data, 8, multipart)
    having = [i for i, part in enumerate(parts) if all(name in part["sizes"] for name in names)]
    if not having:
        raise Missing(f"no part with the channels {', '.join(names)}")
    index, part = having[0], parts[having[0]]
    tables = [chunks(part) for part in parts]
    at += 8 * sum(tables[:index])
    offsets = struct.unpack_from(f"<{tables[index]}Q", data, at)
    return pixels(data, part, offsets, names, 4 if multipart else 0)


def headers(data, at, multipart):
    """The headers of all parts, and where they end."""
    parts = []
    while data[at] or not parts:
        attributes, at = header(data, at)
        parts.append(described(attributes))
        if not multipart:
            return parts, at
    return parts, at + 1


def header(data, at):
    """Attributes by name, and the place after the header."""
    found = {}
    while data[at]:
        name, at = text(data, at)
        _, at = text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        found[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    return found, at + 1


def text(data, at):
    """A text that ends with a zero, and the place after it."""
    end = at + bytes(data[at : at + 256]).index(0)
    return bytes(data[at:end]).decode(errors="replace"), end + 1


def described(attributes):
    """Window, compression and channels of a part."""
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    sizes, at = {}, 0
    while attributes["channels"][at]:
        name, at = text(attributes["channels"], at)
        (kind,) = struct.unpack_from("<i", attributes["channels"], at)
        sizes[name] = TYPES[kind]
        at += 16
    compression = attributes["compression"][0]
    return {
        "sizes": sizes,
        "width": right - left + 1,
        "height": bottom - top + 1,
        "top": top,
        "lines": LINES[compression],
    }


def chunks(part):
    return -(-part["height"] // part["lines"])


def pixels(data, part, offsets, names, skipped):
    """The wanted channels; `skipped` bytes (the part's number) stand before each chunk."""
    width, height, sizes = part["width"], part["height"], part["sizes"]
    line = sum(width * kind.itemsize for kind in sizes.values())
    out = np.zeros((height, width, len(names)), np.float32)
    for offset in offsets:
        y, size = struct.unpack_from("<ii", data, offset + skipped)
        y -= part["top"]
        lines = min(part["lines"], height - y)
        start = offset + skipped + 8
        raw = unpacked(data[start : start + size], lines * line)
        for row in range(lines):
            at = row * line
            for name, kind in sizes.items():
                if name in names:
                    out[y + row, :, names.index(name)] = np.frombuffer(raw, kind, width, at)
                at += width * kind.itemsize
    return out


def unpacked(packed, size):
    """A chunk's bytes: stored as they are where ZIP would not shrink them, else deflated differences of split bytes."""
    if len(packed) == size:
        return bytes(packed)
    differences = np.frombuffer(zlib.decompress(packed), np.uint8)
    if differences.size != size:
        raise ValueError(f"a chunk of {differences.size} bytes, expected {size}")
    values = np.cumsum(differences, dtype=np.int64) - 128 * np.arange(size)
    raw = np.empty(size, np.uint8)
    raw[0::2], raw[1::2] = np.split(values.astype(np.uint8), [(size + 1) // 2])
    return raw.tobytes()


def write(path, picture):
    """Writes RGBA of shape (height, width, 4), the top row first, as full floats; under another name first."""
    height, width = picture.shape[:2]
    names, zip_lines = "ABGR", LINES[ZIP]
    channels = b"".join(name.encode() + struct.pack("<x4i", 2, 0, 1, 1) for name in names) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    attributes = [
        ("channels", "chlist", channels),
        ("compression", "compression", bytes([ZIP])),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    ]
    head = struct.pack("<II", MAGIC, 2)
    for name, kind, value in attributes:
        head += f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value
    head += b"\0"
    # By line, and in a line by channel in the order of their names.
    planes = np.ascontiguousarray(picture[..., ["RGBA".index(name) for name in names]].transpose(0, 2, 1), "<f4")
    blocks = []
    for top in range(0, height, zip_lines):
        block = packed(planes[top : top + zip_lines].tobytes())
        blocks.append(struct.pack("<ii", top, len(block)) + block)
    at, offsets = len(head) + 8 * len(blocks), []
    for block in blocks:
        offsets.append(at)
        at += len(block)
    unfinished = path.with_name(f".{path.name}.part")
    try:
        unfinished.write_bytes(b"".join([head, struct.pack(f"<{len(offsets)}Q", *offsets), *blocks]))
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def packed(raw):
    """The inverse of `unpacked`."""
    data = np.frombuffer(raw, np.uint8)
    split = np.concatenate([data[0::2], data[1::2]]).astype(np.int64)
    differences = np.diff(split, prepend=split[:1]) + 128
    differences[:1] = split[:1]
    small = zlib.compress(differences.astype(np.uint8).tobytes())
    return small if len(small) < len(raw) else raw
