"""Gradient-domain frames: OIDN, corrections without and with the differences' term, screened Poisson, and equal work.

    python -m scenes.gradients OUT
    python -m bench.gradients --frames OUT [--preset balanced] [--seeds 1,2]

For every frame of `scenes.gradients` and every column: the error across the reference's halves, in brackets relL2, both
divided by OIDN's on that frame; and the brightness, that of the picture over that of the reference. Equal work is three
times the samples without differences. Needs NumPy and OpenEXR.
"""

import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from .common import REPOSITORY, about, environment, folder, heading, numbers, parser, program

sys.path.insert(0, str(REPOSITORY / "reference-py"))

# The weight of the term that the page recommends.
WITH = ["--set", "differences=0.3"]
# Columns: whose frame, what is z, and further arguments of the fit; no arguments: z itself is measured.
COLUMNS = {
    "without": ("own", "oidn", []),
    "with": ("own", "oidn", WITH),
    "with, 1": ("own", "oidn", ["--set", "differences=1"]),
    "Poisson L2": ("own", "L2", None),
    "Poisson L1": ("own", "L1", None),
    "corrected L1, without": ("own", "L1", []),
    "corrected L1, with": ("own", "L1", WITH),
    "unjudged, without": ("own", "oidn", ["--set", "composition=halves"]),
    "unjudged, with": ("own", "oidn", ["--set", "composition=halves", *WITH]),
    "OIDN, equal work": ("work", "oidn", None),
    "corrected, equal work": ("work", "oidn", []),
}


def main(arguments=None):
    made = parser("bench/gradients", __doc__)
    made.add_argument("--frames", type=folder, required=True, metavar="OUT", help="folder of the frames")
    made.add_argument("--scene", action="append", metavar="NAME", help="only this scene; repeatable")
    made.add_argument("--column", action="append", choices=COLUMNS, metavar="NAME", help="only this column; repeatable")
    made.add_argument(
        "--seeds", type=numbers, default=[1], metavar="1,2", help="geometric means over these (default 1)"
    )
    made.add_argument("--noise", action="store_true", help="only the noise of differences, by region")
    made.add_argument("--more", default="", metavar="ARGUMENTS", help="further arguments of sspc-train fit")
    options = made.parse_args(arguments)
    if options.noise:
        return noise_by_region(options)
    train = program(options, "sspc-train")
    head = about("bench/gradients", arguments, options, [train])
    print(heading(head), end="\n\n")
    columns = {name: COLUMNS[name] for name in options.column or COLUMNS}
    print("| frame | OIDN's relL2 | noise of differences | " + " | ".join(columns) + " |")
    print("|---|---|---|" + "---|" * len(columns))
    for first in sorted(
        options.frames.glob("*/*spp.a.exr"), key=lambda path: (path.parent.name, len(path.name), path.name)
    ):
        if options.scene and first.parent.name not in options.scene:
            continue
        frame = Frame(first)
        if not frame.reference:
            print(f"{frame.name}: no reference", file=sys.stderr)
            continue
        cells = [shown_figures(frame.measure(train, *column, options)) for column in columns.values()]
        print(
            f"| {frame.name} | {error(frame.z(), frame.references):.5f} | {frame.quietness():.3f} | "
            + " | ".join(cells)
            + " |",
            flush=True,
        )
    return 0


# By how much albedo and normal of a pixel and the next one differ, summed over channels: below the first it is smooth,
# from the last on an edge.
REGIONS = (0.02, 0.1, 0.4)


def noise_by_region(options):
    """The variance of dx and dy over that of differences of y, by how much albedo and normal change, and on glass."""
    steps = [f"below {REGIONS[0]}", *(f"{a} to {b}" for a, b in pairwise(REGIONS)), f"from {REGIONS[-1]}"]
    print("| frame | " + " | ".join(steps) + " | white albedo (glass) |")
    print("|---|" + "---|" * (len(steps) + 1))
    for first in sorted(options.frames.glob("*/*spp.a.exr")):
        if not options.scene or first.parent.name in options.scene:
            print(f"| {Frame(first).name} | " + " | ".join(Frame(first).noise_by_region()) + " |", flush=True)
    return 0


def shown_figures(figures):
    if figures is None:
        return ""
    across, relative, brightness = figures
    return f"{across:.3f} ({relative:.3f}) {brightness:.3f}"


class Frame:
    """A frame of `scenes.gradients`."""

    def __init__(self, first):
        self.folder, self.spp = first.parent, int(first.name.partition("spp")[0])
        self.name = f"{self.folder.name}, {self.spp}"
        path = self.folder / "ref.exr"
        self.reference = path if path.is_file() else None
        self.references = [picture(read(path), half) for half in "ab"] if self.reference else None

    def files(self, whose):
        spp, place = (self.spp, self.folder) if whose == "own" else (3 * self.spp, self.folder / "work")
        return [place / f"{spp}spp.{name}.exr" for name in ("a", "b", "denoised")]

    def z(self, whose="own"):
        return picture(read(self.files(whose)[2]), "")

    def quietness(self):
        """The variance of dx and dy over that of differences of y: the median over pixels' surroundings."""
        a, b = (read(path) for path in self.files("own")[:2])
        noise = [surroundings((picture(a, name) - picture(b, name)) ** 2) for name in ("", "dx", "dy")]
        return float(np.median((noise[1] + noise[2]) / np.maximum(4 * noise[0], 1e-12)))

    def noise_by_region(self):
        """Cells: the ratio of the variances, in brackets the share of the pixels."""
        a, b = (read(path) for path in self.files("own")[:2])
        albedo = 0.5 * (picture(a, "albedo") + picture(b, "albedo"))
        normal = 0.5 * np.stack([a[f"normal.{axis}"] + b[f"normal.{axis}"] for axis in "XYZ"], axis=-1)
        features, apart = np.concatenate([albedo, normal], axis=-1), picture(a, "") - picture(b, "")
        found = []
        for axis, name in ((1, "dx"), (0, "dy")):
            change = np.abs(np.diff(features, axis=axis)).sum(-1).ravel()
            inside = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
            given = ((picture(a, name) - picture(b, name))[inside] ** 2).mean(-1).ravel()
            plain = (np.diff(apart, axis=axis) ** 2).mean(-1).ravel()
            found.append(np.stack([change, given, plain, (albedo.min(-1) > 0.99)[inside].ravel()]))
        change, given, plain, is_glass = np.concatenate(found, axis=1)
        edges = [0, *REGIONS, np.inf]
        regions = [(low <= change) & (change < high) & (is_glass == 0) for low, high in pairwise(edges)]
        cells = []
        for region in [*regions, is_glass == 1]:
            # One firefly would decide: differences of y count as no larger than all but one in 200 of them.
            most = np.quantile(plain[region], 0.995) if region.any() else 0
            ratio = np.minimum(given[region], most).mean() / np.minimum(plain[region], most).mean() if most else np.nan
            cells.append(f"{ratio:.2f} ({region.mean():.2f})" if region.any() else "")
        return cells

    def measure(self, train, whose, denoiser, arguments, options):
        """Error across halves and relL2 over OIDN's, and brightness; or None where the column's frame is not there."""
        files = self.files(whose)
        if not files[2].is_file():
            return None
        with tempfile.TemporaryDirectory(prefix="bench-gradients-") as scratch:
            pictures = self.poisson(Path(scratch), denoiser) if denoiser != "oidn" else [None, None, files[2]]
            if arguments is None:
                return self.figures(picture(read(pictures[2]), ""))
            roles = [f"--denoised-{half}={path}" for half, path in zip("ab", pictures, strict=False) if path]
            found = []
            for seed in options.seeds:
                out = Path(scratch) / f"seed{seed}"
                command = [train, "fit", *files[:2], *roles, f"--denoised={pictures[2]}", f"--seed={seed}", *arguments]
                command += ["--quiet", "-o", out, *options.more.split()]
                subprocess.run([str(word) for word in command], check=True, env=environment(options))
                found.append(self.figures(picture(read(out / "corrected.exr"), "")))
        return np.exp(np.mean(np.log(found), axis=0))

    def figures(self, values):
        """METHOD (17) and (16) over those of OIDN's picture, and the mean over that of the reference."""
        z, base = self.z(), error(self.z(), self.references)
        across = 1 - gain(z, values, self.references) / base
        brightness = values.mean() / (0.5 * (self.references[0] + self.references[1])).mean()
        return across, error(values, self.references) / base, brightness

    def poisson(self, scratch, norm):
        """Screened-Poisson pictures of half a, half b and their mean, kept beside the frame."""
        from sspc_reference.poisson import reconstruct

        halves = [read(path) for path in self.files("own")[:2]]
        parts = [[picture(half, name) for name in ("", "dx", "dy")] for half in halves]
        parts.append([0.5 * (a + b) for a, b in zip(*parts, strict=True)])
        paths = [self.folder / "poisson" / f"{self.spp}spp.{norm}.{name}.exr" for name in ("a", "b", "denoised")]
        for path, part in zip(paths, parts, strict=True):
            if not path.is_file():
                path.parent.mkdir(exist_ok=True)
                write(path, reconstruct(*part, norm=norm))
        return paths


def surroundings(values, radius=2):
    """Means over the channels and a square of pixels."""
    values = np.pad(values.mean(-1), radius, mode="edge")
    for axis in (0, 1):
        values = sum(np.roll(values, shift, axis) for shift in range(-radius, radius + 1)) / (2 * radius + 1)
    return values[radius:-radius, radius:-radius]


def read(path):
    import OpenEXR

    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return {name: channel.pixels.astype(np.float64) for name, channel in channels.items()}


def picture(channels, layer):
    """A layer as (height, width, 3)."""
    return np.stack([channels[f"{layer}.{end}" if layer else end] for end in "RGB"], axis=-1)


def write(path, values):
    import OpenEXR

    planes = {name: np.ascontiguousarray(values[..., k], dtype=np.float32) for k, name in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes).write(str(path))


def error(values, references):
    """relL2 against the mean of two references, their noise taken out."""
    a, b = references
    return float(np.mean((values - a) * (values - b) / ((0.5 * (a + b)).mean(-1, keepdims=True) ** 2 + 0.01)))


def gain(z, values, references):
    """How much of z's squared error is gone, measured with one reference and divided by the other, METHOD (17)."""
    parts = [
        ((z - a) ** 2 - (values - a) ** 2) / (b.mean(-1, keepdims=True) ** 2 + 0.01)
        for a, b in (references, references[::-1])
    ]
    return float(0.5 * np.mean(parts[0] + parts[1]))


if __name__ == "__main__":
    sys.exit(main())
