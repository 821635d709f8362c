"""The second reader of second_reader.rs: OpenEXR's own Python package writes templates and opens what was made of them.

python second_reader.py make FOLDER      # one folder per case: a.exr, b.exr, denoised{-a,-b,}.exr, roles
python second_reader.py check FOLDER     # out.exr in each against a.exr; prints what is wrong, exits with 1 then
"""

import struct
import sys
from pathlib import Path

import numpy as np
import OpenEXR

HEIGHT, WIDTH = 37, 45
RGB = ("R", "G", "B")
# A standard attribute's name with another type than the standard's, as pipelines stamp it.
FOREIGN = [
    (b"framesPerSecond", b"float", struct.pack("<f", 24)),
    (b"framesPerSecond", b"v2i", struct.pack("<2i", 24000, 1001)),
    (b"multiView", b"string", b"main cam1"),
    (b"timeCode", b"string", b"01:00:00:00"),
    (b"expTime", b"rational", struct.pack("<iI", 1, 48)),
    (b"worldToCamera", b"m44d", struct.pack("<16d", *range(16))),
    (b"chromaticities", b"string", b"ACEScg"),
    (b"adoptedNeutral", b"v2d", struct.pack("<2d", 0.3, 0.3)),
    (b"isoSpeed", b"int", struct.pack("<i", 800)),
    (b"preview", b"string", b"x"),
    (b"tiles", b"string", b"none"),
    (b"type", b"int", struct.pack("<i", 0)),
    (b"name", b"int", struct.pack("<i", 7)),
    (b"view", b"int", struct.pack("<i", 1)),
    (b"chunkCount", b"string", b"3"),
    (b"keyCode", b"keycode", struct.pack("<7i", 1, 2, 3, 4, 5, 4, 64)),
    (b"an attribute whose name is longer than the short ones", b"some type of our own", b"\x00\xff\x10"),
]


def scene(seed, height=HEIGHT, width=WIDTH):
    """A colour picture with edges, [height, width, 3]."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    checker = (x // 8 + y // 8) % 2
    base = np.stack([0.2 + 0.6 * checker, 0.5 - 0.3 * checker, 0.3 + 0.2 * np.sin(x / 5)], -1)
    return (base * (0.5 + 0.01 * ((seed * 7) % 5))).astype(np.float32)


def pictures(seed=0):
    """Noisy halves, denoised halves, denoised full."""
    clean = scene(seed)
    noise = [np.random.default_rng(seed + k).gamma(8, 1 / 8, clean.shape) for k in (1, 2)]
    a, b = ((clean * n).astype(np.float32) for n in noise)
    return {"a": a, "b": b, "denoised-a": 0.99 * clean, "denoised-b": 1.01 * clean, "denoised": clean}


def colour(prefix, picture, kind=np.float32, names=RGB):
    """Channels of a layer."""
    return {
        (prefix + "." if prefix else "") + n: np.ascontiguousarray(picture[..., c]).astype(kind)
        for c, n in enumerate(names)
    }


def others(kind=np.float32):
    """Channels that must come through bit for bit."""
    rng = np.random.default_rng(99)
    depth = rng.random((HEIGHT, WIDTH)).astype(np.float32) * 1e4
    depth[3, 4] = np.nan
    return {
        "A": np.ones((HEIGHT, WIDTH), kind),
        "depth.Z": depth,
        "id.Y": rng.integers(0, 2**32, (HEIGHT, WIDTH), np.uint32),
    }


def write(path, parts):
    """A file of (header, channels); one of them makes a single part."""
    scan = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    made = [({**scan, **header}, channels) for header, channels in parts]
    OpenEXR.File([OpenEXR.Part(h, c, name=h.get("name", "")) for h, c in made]).write(str(path)) if len(
        made
    ) > 1 else OpenEXR.File(*made[0]).write(str(path))


def single(header=None, kind=np.float32, more=None, prefix="", names=RGB):
    """A case of one part: parts of half `key`."""
    return lambda picture, key: [
        (header or {}, {**colour(prefix, picture, kind, names), **others(kind), **(more or {})})
    ]


def tiles(mode):
    """A header of tiles."""
    description = OpenEXR.TileDescription()
    description.xSize, description.ySize, description.mode = 16, 16, mode
    return {"type": OpenEXR.tiledimage, "tiles": description}


def window(left, top):
    """A data window at a place inside a larger frame."""
    low, high = np.array([left, top], np.int32), np.array([left + WIDTH - 1, top + HEIGHT - 1], np.int32)
    return {"dataWindow": (low, high), "displayWindow": (np.array([0, 0], np.int32), np.array([199, 149], np.int32))}


def with_part(header, channels, name="fog"):
    """The colour, and a part that nobody needs."""

    def parts(picture, key):
        return [({"name": "rgba"}, {**colour("", picture), **others()}), ({"name": name, **header}, channels)]

    return parts


def deep():
    """Channels of a deep part."""
    rng = np.random.default_rng(5)
    z = np.empty((HEIGHT, WIDTH), dtype=object)
    for y in range(HEIGHT):
        for x in range(WIDTH):
            z[y, x] = rng.random(int(rng.integers(1, 4))).astype(np.float32)
    return {"Z": z}


def light(picture, key):
    """A light of its own beside the picture."""
    return [({}, {**colour("", scene(3)), **others(), **colour("RGBA_key", picture)})]


def by_parts(picture, key):
    """R, G and B in parts of their own."""
    return [({"name": f"part{c}"}, {n: np.ascontiguousarray(picture[..., c])}) for c, n in enumerate(RGB)]


def stereo(picture, key):
    """Two views, each with its noisy colour."""
    left = {**colour("L.Noisy Image.left", picture), **colour("L.Combined.left", 0.98 * picture)}
    right = {**colour("L.Noisy Image.right", picture[::-1]), **colour("L.Combined.right", 0.98 * picture[::-1])}
    return [({"multiView": ["left", "right"]}, {**left, **right})]


LOSSY = {"PXR24", "B44", "B44A", "DWAA", "DWAB"}
# name: parts of a half, channels of the output that hold the picture, role arguments, whether denoised files are given
CASES = {
    **{
        f"compression {c}": (single({"compression": getattr(OpenEXR, c + "_COMPRESSION")}), RGB, "")
        for c in ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
    },
    "half": (single(kind=np.float16), RGB, ""),
    "decreasing": (single({"lineOrder": OpenEXR.DECREASING_Y}), RGB, ""),
    "window": (single(window(30, -14)), RGB, ""),
    "tiles": (single(tiles(OpenEXR.LevelMode.ONE_LEVEL)), RGB, ""),
    "long name": (
        single(more={"a layer with a name of more than thirty-one bytes.X": np.ones((HEIGHT, WIDTH), np.float32)}),
        RGB,
        "",
    ),
    "utf-8": (single(prefix="视图层.Größe"), tuple("视图层.Größe." + n for n in RGB), "radiance=视图层.Größe"),
    "small letters": (single(names=("r", "g", "b")), ("r", "g", "b"), ""),
    "light": (light, tuple("RGBA_key." + n for n in RGB), "radiance=RGBA_key"),
    "deep part": (with_part({"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}, deep()), RGB, ""),
    "htj2k part": (
        with_part({"compression": OpenEXR.HTJ2K256_COMPRESSION}, {"Z": np.ones((HEIGHT, WIDTH), np.float32)}),
        RGB,
        "",
    ),
    "lossy part": (with_part({"compression": OpenEXR.DWAB_COMPRESSION}, {"R": scene(4)[..., 0].copy()}), RGB, ""),
    "R, G, B in parts": (by_parts, RGB, "radiance=part0.R,part1.G,part2.B"),
    "views": (stereo, tuple(f"L.Combined.{v}.{n}" for v in ("left", "right") for n in RGB), "view=all"),
    **{f"attribute {n.decode()} {k.decode()}": (single(), RGB, (n, k, v)) for n, k, v in FOREIGN},
}


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
                if key in "ab" or name == "views"
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


def wrong(case, name):
    """What of an output is not as it should be."""
    _, picture, roles = CASES[name]
    version, before, _ = raw(case / "a.exr")
    now, after, _ = raw(case / "out.exr")
    allowed = {b"channels"} if name == "half" else set()
    allowed |= {b"compression"} if any(name == f"compression {c}" for c in LOSSY) else set()
    if version != now or len(before) != len(after):
        yield f"flags {version:#x} became {now:#x}"
    for old, new in zip(before, after):
        kept = [a for a in new if not a[0].startswith(b"sspc.")]
        if [a for a in kept if a[0] not in allowed] != [a for a in old if a[0] not in allowed]:
            yield f"attributes {old} became {kept}"
    found = 0
    for old, new in zip(opened(case / "a.exr"), opened(case / "out.exr")):
        if old.keys() != new.keys():
            yield f"channels {set(old)} became {set(new)}"
        for channel, pixels in old.items():
            is_picture = channel in picture and not (name.endswith("part") and set(old) == {"R"})
            found += is_picture
            if is_picture == same(pixels, new[channel]):
                yield f"{channel} {'is not replaced' if is_picture else 'is not what it was'}"
    if found != len(picture):
        yield f"{found} channels of the picture"


def check(folder):
    """Whether every output is as it should be."""
    bad = [f"{name}: {what}" for n, name in enumerate(CASES) for what in wrong(Path(folder) / f"{n:02}", name)]
    print("\n".join(bad))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit({"make": make, "check": check}[sys.argv[1]](sys.argv[2]))
