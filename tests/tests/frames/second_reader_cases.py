"""The cases of second_reader.py: templates written by OpenEXR's own Python package, and what outputs must hold."""

import struct

import numpy as np
import OpenEXR

HEIGHT, WIDTH = 37, 45
RGB = ("R", "G", "B")
# A standard attribute's name with another type than the standard's, as pipelines stamp it.
FOREIGN = [
    (name, kind, value)
    for names, kind, value in [
        (b"framesPerSecond near isoSpeed", b"float", struct.pack("<f", 24)),
        (b"framesPerSecond", b"v2i", struct.pack("<2i", 24000, 1001)),
        (b"multiView", b"string", b"main cam1"),
        (b"framesPerSecond timeCode utcOffset focus worldToNDC chromaticities envmap keyCode", b"string", b"01:00:00"),
        (b"preview chunkCount tiles far fieldOfView originalDataWindow capDate wrapmodes name", b"string", b"none"),
        (b"owner capDate isoSpeed whiteLuminance xDensity wrapmodes name view type near", b"int", struct.pack("<i", 7)),
        (b"dwaCompressionLevel software preview comments channel", b"int", struct.pack("<i", 45)),
        (b"expTime", b"rational", struct.pack("<iI", 1, 48)),
        (b"aperture longitude", b"double", struct.pack("<d", 2.8)),
        (b"worldToCamera", b"m44d", struct.pack("<16d", *range(16))),
        (b"adoptedNeutral", b"v2d", struct.pack("<2d", 0.3, 0.3)),
        (b"version", b"float", struct.pack("<f", 1)),
        (b"comments", b"stringvector", struct.pack("<i", 2) + b"hi"),
        (b"keyCode", b"keycode", struct.pack("<7i", 1, 2, 3, 4, 5, 4, 64)),
    ]
    for name in names.split()
] + [(b"an attribute whose name is longer than the short ones", b"some type of our own", b"\x00\xff\x10")]


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


# Lights of a picture: each has its share of the light, which changes across the picture.
LIGHTS = ("key", "fill", "rim")


def share(light):
    """A light's share of the colour, [height, width, 1]; all of them are 1."""
    x = np.linspace(0, 1, WIDTH, dtype=np.float32)[None, :, None]
    y = np.linspace(0, 1, HEIGHT, dtype=np.float32)[:, None, None]
    key, fill = 0.2 + 0.5 * x, 0.1 + 0.15 * y
    return {"key": key + 0 * y, "fill": fill + 0 * x, "rim": 1 - key - fill}[light]


def texture(seed):
    """What a lobe is multiplied by, [height, width, 3]."""
    return 0.25 + 0.5 * scene(seed + 1)


def lit(name, kind=np.float32, view=""):
    """Channels of a picture at the root, or of the layer `view`, that is the sum of its lights, called name(light)."""

    def channels(picture, key):
        passes = {light: (share(light) * picture).astype(kind) for light in LIGHTS}
        whole = sum(p.astype(np.float32) for p in passes.values())
        made = {k: v for light, p in passes.items() for k, v in colour(name(light), p, kind).items()}
        return {**colour(view, whole, kind), **made, **others(kind)}

    return channels


def lit_case(name, kind=np.float32, header=None):
    """A case of one part."""
    return lambda picture, key: [(header or {}, lit(name, kind)(picture, key))]


def lit_parts(picture, key):
    """A part for each light."""
    made = lit(lambda light: "RGBA_" + light)(picture, key)
    parts = [({"name": "rgba"}, {n: p for n, p in made.items() if not n.startswith("RGBA_")})]
    for light in LIGHTS:
        prefix = f"RGBA_{light}."
        parts.append(({"name": prefix[:-1]}, {n[len(prefix) :]: p for n, p in made.items() if n.startswith(prefix)}))
    return parts


def lobes(picture, key):
    """Cycles' lobes: one is divided by its colour."""
    light, other = share("key") * picture / texture(7), (1 - share("key")) * picture
    return [
        (
            {},
            {
                **colour("V.Combined", light * texture(7) + other),
                **colour("V.Diffuse Direct", light),
                **colour("V.Diffuse Color", texture(7)),
                **colour("V.Emission", other),
                **others(),
            },
        )
    ]


def lit_stereo(picture, key):
    """Two views, each with its lights."""
    channels = {}
    for view, seen in (("left", picture), ("right", picture[::-1])):
        channels |= lit(lambda light, v=view: f"RGBA_{light}.{v}", view=f"RGBA.{view}")(seen, key)
        clean = scene(list(CASES).index("passes views"))
        denoised = {"a": 0.99, "b": 1.01}.get(key, 1) * (clean if view == "left" else clean[::-1])
        channels |= colour(f"RGBA_denoised.{view}", denoised)
    return [({"multiView": ["left", "right"]}, channels)]


def passes_of(*prefixes):
    """The channels of a picture at the root and of these layers."""
    return RGB + tuple(f"{prefix}.{n}" for prefix in prefixes for n in RGB)


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
    # The whole program, with passes; what follows "run" are its arguments.
    "passes": (lit_case("RGBA_{}".format), passes_of("RGBA_key", "RGBA_fill", "RGBA_rim"), "run --passes auto"),
    "passes half": (
        lit_case("RGBA_{}".format, np.float16),
        passes_of("RGBA_key", "RGBA_fill", "RGBA_rim"),
        "run --passes auto",
    ),
    "passes tiles": (
        lit_case("{}".format, header={**tiles(OpenEXR.LevelMode.ONE_LEVEL), "compression": OpenEXR.PIZ_COMPRESSION}),
        passes_of("key", "fill", "rim"),
        "run --passes key,fill,rim",
    ),
    "passes named": (lit_case("光.{}".format), passes_of("光.key", "光.fill", "光.rim"), "run --passes 光.*"),
    "passes in parts": (lit_parts, passes_of("RGBA_key", "RGBA_fill", "RGBA_rim"), "run --passes auto"),
    "passes lobes": (
        lobes,
        tuple(f"V.{layer}.{n}" for layer in ("Combined", "Diffuse Direct", "Emission") for n in RGB),
        "run --passes auto",
    ),
    "passes views": (
        lit_stereo,
        tuple(f"RGBA{of}.{v}.{n}" for of in ("", "_key", "_fill", "_rim") for v in ("left", "right") for n in RGB),
        "run --passes auto --view all",
    ),
    "views run": (stereo, tuple(f"L.Combined.{v}.{n}" for v in ("left", "right") for n in RGB), "run --view all"),
    **{f"attribute {n.decode()} {k.decode()}": (single(), RGB, (n, k, v)) for n, k, v in FOREIGN},
}


def sums(name, number):
    """Pictures that are sums: layer, its terms (layer, factor, what it is without noise), and the picture's truth."""
    clean = scene(number)
    if name == "passes lobes":
        lobe, other = share("key") * clean / texture(7), (1 - share("key")) * clean
        return [("V.Combined", [("V.Diffuse Direct", texture(7), lobe), ("V.Emission", 1, other)], clean)]
    if name == "passes views":
        seen = {"left": clean, "right": clean[::-1]}
        lights = {v: [(f"RGBA_{light}.{v}", 1, share(light) * seen[v]) for light in LIGHTS] for v in seen}
        return [(f"RGBA.{view}", lights[view], seen[view]) for view in seen]
    if name == "views run":
        return []
    prefix = {"passes tiles": "", "passes named": "光."}.get(name, "RGBA_")
    return [("", [(prefix + light, 1, share(light) * clean) for light in LIGHTS], clean)]
