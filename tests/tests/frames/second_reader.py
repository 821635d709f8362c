"""The second reader of second_reader.rs: OpenEXR's own Python package writes templates and opens what was made of them;
so does OpenImageIO, where it is installed.

python second_reader.py make FOLDER      # one folder per case: a.exr, b.exr, denoised{-a,-b,}.exr, roles
python second_reader.py check FOLDER     # out.exr in each against a.exr; prints what is wrong, exits with 1 then
"""

import struct
import sys
from pathlib import Path

import numpy as np
import OpenEXR
from second_reader_cases import CASES, HEIGHT, LOSSY, RGB, colour, pictures, sums, window, write

try:
    import OpenImageIO
except ImportError:
    OpenImageIO = None


def raw(path):
    """Version, flags and, part by part, (name, type, bytes) of every attribute."""
    data = Path(path).read_bytes()
    version, at, headers = struct.unpack_from("<I", data, 4)[0], 8, []
    while True:
        header = []
        while data[at]:
            fields = []
            for _ in range(2):
                end = data.index(0, at)
                fields.append(data[at:end])
                at = end + 1
            (size,) = struct.unpack_from("<i", data, at)
            header.append((*fields, data[at + 4 : at + 4 + size]))
            at += 4 + size
        at += 1
        headers.append(header)
        if not version & 0x1000 or not data[at]:
            return version, headers, at + (1 if version & 0x1000 else 0)


def stamp(path, attribute):
    """Adds a raw attribute to a file of one part."""
    data = Path(path).read_bytes()
    version, (header,), end = raw(path)
    attributes = [a for a in header if a[0] != attribute[0]] + [attribute]
    body = b"".join(n + b"\0" + k + b"\0" + struct.pack("<i", len(v)) + v for n, k, v in attributes) + b"\0"
    moved = 8 + len(body) - end
    chunks = -(-HEIGHT // 16)
    table = struct.unpack_from(f"<{chunks}Q", data, end)
    long = 0x400 if any(len(n) > 31 or len(k) > 31 for n, k, _ in attributes) else 0
    start = data[:4] + struct.pack("<I", version | long) + body
    Path(path).write_bytes(start + struct.pack(f"<{chunks}Q", *(t + moved for t in table)) + data[end + 8 * chunks :])


def make(folder):
    """Writes the files of every case."""
    for number, (name, (parts, _, roles)) in enumerate(CASES.items()):
        case = Path(folder) / f"{number:02}"
        case.mkdir(parents=True)
        for key, picture in pictures(number).items():
            write(
                case / f"{key}.exr",
                parts(picture, key)
                if key in "ab" or "views" in name
                else [({k: v for k, v in window(30, -14).items()} if name == "window" else {}, colour("", picture))],
            )
            if isinstance(roles, tuple) and key in "ab":
                stamp(case / f"{key}.exr", roles)
        (case / "roles").write_text(roles if isinstance(roles, str) else "", encoding="utf-8")


def opened(path):
    """Channels of every part."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return [{n: c.pixels for n, c in part.channels.items()} for part in file.parts]


def same(x, y):
    """The same bits; deep pixels too."""
    if x.dtype == object:
        return all((p is None and q is None) or np.array_equal(p, q) for p, q in zip(x.ravel(), y.ravel()))
    return x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes()


def layer(channels, prefix):
    """A layer's three channels, [height, width, 3] in double precision."""
    return np.stack([channels[(prefix + "." if prefix else "") + n].astype(np.float64) for n in RGB], -1)


def wrong_sums(case, name):
    """What of corrected passes is not as it should be: they add up to the picture, and each is nearer to its light
    without noise than half a's is: no two of them, and no two channels, are exchanged."""
    noisy, made = (
        {k: p for n, part in named(case / f"{file}.exr") for k, p in flat(n, part).items()} for file in ("a", "out")
    )
    # Half an ulp of the largest term: 2^-11 of it in half floats, 2^-24 in single floats.
    tolerance = 4.9e-4 if name == "passes half" else 2.4e-7
    for picture, terms, clean in sums(name, int(case.name)):
        for prefix, _, truth in [*terms, (picture, 1, clean)]:
            before, after = (np.abs(layer(of, prefix) - truth).mean((0, 1)) for of in (noisy, made))
            if not (after < 0.5 * before).all():
                yield f"{prefix or 'the picture'} is {after} off, half a is {before}"
        each = [layer(made, prefix) * factor for prefix, factor, _ in terms]
        whole = layer(made, picture)
        largest = np.max([np.abs(part) for part in [*each, whole]], 0)
        off = (np.abs(sum(each) - whole) / np.maximum(largest, 1e-6)).max()
        if not off <= tolerance:
            yield f"the passes of {picture or 'the root'} are {off} of it from its sum"


def named(path):
    """Name and channels of every part."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return [(part.header.get("name", ""), {n: c.pixels for n, c in part.channels.items()}) for part in file.parts]


def flat(part, channels):
    """Channels led by their part's name, but for the first part's and those of single parts."""
    return {n if part in ("", "rgba") else f"{part}.{n}": p for n, p in channels.items()}


def wrong_elsewhere(case):
    """What OpenImageIO reads otherwise than OpenEXR, in an output whose template it reads."""
    if OpenImageIO is None or not all(isinstance(p, dict) for p in images(case / "a.exr")):
        return
    parts = opened(case / "out.exr")
    for number, (part, read) in enumerate(zip(parts, images(case / "out.exr"))):
        if not isinstance(read, dict):
            yield f"OpenImageIO refuses part {number}: {read}"
            continue
        for channel, pixels in part.items():
            if pixels.dtype in (np.float16, np.float32) and not any(
                np.array_equal(pixels.astype(np.float32), other, equal_nan=True)
                for other_name, other in read.items()
                if other_name == channel or other_name.endswith("." + channel)
            ):
                yield f"OpenImageIO reads {channel} of part {number} otherwise, among {sorted(read)}"


def images(path):
    """Channels of every part as OpenImageIO reads them, or what it says where it does not."""
    file, parts = OpenImageIO.ImageInput.open(str(path)), []
    if file is None:
        return [OpenImageIO.geterror()]
    while file.seek_subimage(len(parts), 0):
        spec = file.spec()
        pixels = None if spec.deep else file.read_image(len(parts), 0, 0, spec.nchannels, OpenImageIO.FLOAT)
        if spec.deep:
            parts.append({})
        elif pixels is None:
            parts.append(file.geterror())
        else:
            parts.append({name: pixels[..., at] for at, name in enumerate(spec.channelnames)})
    file.close()
    return parts


def wrong(case, name):
    """What of an output is not as it should be."""
    _, picture, roles = CASES[name]
    if isinstance(roles, str) and roles.startswith("run "):
        yield from wrong_sums(case, name)
    yield from wrong_elsewhere(case)
    version, before, _ = raw(case / "a.exr")
    now, after, _ = raw(case / "out.exr")
    allowed = {b"channels"} if "half" in name else set()
    allowed |= {b"compression"} if any(name == f"compression {c}" for c in LOSSY) else set()
    if version != now or len(before) != len(after):
        yield f"flags {version:#x} became {now:#x}"
    for old, new in zip(before, after):
        kept = [a for a in new if not a[0].startswith(b"sspc.")]
        if [a for a in kept if a[0] not in allowed] != [a for a in old if a[0] not in allowed]:
            yield f"attributes {old} became {kept}"
    found = 0
    for (part, old), (_, new) in zip(named(case / "a.exr"), named(case / "out.exr")):
        if old.keys() != new.keys():
            yield f"channels {set(old)} became {set(new)}"
        for channel, pixels in old.items():
            full = f"{part}.{channel}" if part.startswith("RGBA_") else channel
            is_picture = full in picture and not (name.endswith("part") and set(old) == {"R"})
            found += is_picture
            if is_picture == same(pixels, new[channel]):
                yield f"{channel} {'is not replaced' if is_picture else 'is not what it was'}"
    if found != len(picture):
        yield f"{found} channels of the picture"


def check(folder):
    """Whether every output is as it should be."""
    bad = [f"{name}: {what}" for n, name in enumerate(CASES) for what in wrong(Path(folder) / f"{n:02}", name)]
    print("\n".join(bad) or ("without OpenImageIO" if OpenImageIO is None else "both readers"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit({"make": make, "check": check}[sys.argv[1]](sys.argv[2]))
