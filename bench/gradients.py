"""Gradient-domain frames: OIDN, corrections without and with the differences' term, screened Poisson, and equal work.

    python -m scenes.gradients OUT
    python -m bench.gradients --frames OUT [--preset balanced] [--seeds 1,2]

For every frame of `scenes.gradients`: relL2 with the reference's noise taken out, divided by OIDN's on that frame.
Equal work is three times the samples without differences. Needs NumPy and OpenEXR.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from .common import REPOSITORY, about, environment, folder, numbers, parser, program

sys.path.insert(0, str(REPOSITORY / "reference-py"))

# Columns: whose frame, what is z, and further arguments of the fit; no arguments: z itself is measured.
COLUMNS = {
    "without": ("own", "oidn", []),
    "with": ("own", "oidn", ["--set", "differences=1"]),
    "Poisson L2": ("own", "L2", None),
    "Poisson L1": ("own", "L1", None),
    "corrected L1, without": ("own", "L1", []),
    "corrected L1, with": ("own", "L1", ["--set", "differences=1"]),
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
    made.add_argument("--more", default="", metavar="ARGUMENTS", help="further arguments of sspc-train fit")
    options = made.parse_args(arguments)
    train = program(options, "sspc-train")
    head = about("bench/gradients", arguments, options, [train])
    print(f"Commit {head['commit']}, {head['date']}, {head['machine']['processor']}\n")
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
        base = error(frame.z(), frame.references)
        values = [frame.measure(train, *column, options) for column in columns.values()]
        cells = ["" if value is None else f"{value / base:.3f}" for value in values]
        print(f"| {frame.name} | {base:.5f} | {frame.quietness():.3f} | " + " | ".join(cells) + " |", flush=True)
    return 0


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

    def measure(self, train, whose, denoiser, arguments, options):
        """relL2 of one column, or None where its frame is not there."""
        files = self.files(whose)
        if not files[2].is_file():
            return None
        with tempfile.TemporaryDirectory(prefix="bench-gradients-") as scratch:
            pictures = self.poisson(Path(scratch), denoiser) if denoiser != "oidn" else [None, None, files[2]]
            if arguments is None:
                return error(picture(read(pictures[2]), ""), self.references)
            roles = [f"--denoised-{half}={path}" for half, path in zip("ab", pictures, strict=False) if path]
            errors = []
            for seed in options.seeds:
                out = Path(scratch) / f"seed{seed}"
                command = [train, "fit", *files[:2], *roles, f"--denoised={pictures[2]}", f"--seed={seed}", *arguments]
                command += ["--quiet", "-o", out, *options.more.split()]
                subprocess.run([str(word) for word in command], check=True, env=environment(options))
                errors.append(error(picture(read(out / "corrected.exr"), ""), self.references))
        return float(np.exp(np.mean(np.log(errors))))

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


if __name__ == "__main__":
    sys.exit(main())
