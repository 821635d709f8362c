"""bench/passes: every corrected pass against Open Image Denoise on that pass alone, and how well passes add up."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from .common import about, environment, folder, heading, parser, program

DESCRIPTION = """\
Fits frames of `python -m scenes.passes OUT`, corrects their passes and measures each as it is in the file: relL2
with the reference's noise taken out, divided by that of Open Image Denoise (high quality, albedo and normal) on that
pass alone.
Needs NumPy, OpenEXR and pyoidn."""

WAYS = ("filter", "oidn")


def main(arguments=None):
    made = parser("bench/passes", DESCRIPTION)
    made.add_argument("--frames", type=folder, required=True, metavar="OUT", help="folder of the frames")
    made.add_argument("--scene", action="append", metavar="NAME", help="only this scene; repeatable")
    made.add_argument("--by", action="append", choices=WAYS, help="only this way (default: both)")
    made.add_argument("--more", default="", metavar="ARGUMENTS", help="further arguments of sspc-train fit")
    options = made.parse_args(arguments)
    train = program(options, "sspc-train")
    head = about("bench/passes", arguments, options, [train])
    print(heading(head), end="\n\n")
    print("| frame | way | beauty | sets of passes: geometric mean, worst | OIDN's own sum | ours | seconds |")
    print("|---|---|---|---|---|---|---|")
    ratios = {}
    for first in sorted(options.frames.glob("*/*spp.a.exr")):
        name = f"{first.parent.name}, {first.name.partition('.')[0]}"
        if options.scene and first.parent.name not in options.scene:
            continue
        if not (first.parent / "ref.b.exr").is_file():
            print(f"{name}: no reference", file=sys.stderr)
            continue
        frame = Frame(first)
        for way in options.by or WAYS:
            line, of_sets = frame.measure(train, way, options)
            print(f"| {name} | {way} | {line}", flush=True)
            for what, values in of_sets.items():
                ratios.setdefault((way, what), []).extend(values.values())
            for what, values in of_sets.items():
                print(f"{name}, {way}, {what}: {shown(values)}", file=sys.stderr)
    print()
    for (way, what), values in ratios.items():
        print(f"{what}, {way}: geometric mean {geometric(values):.2f}, worst {max(values):.2f} of {len(values)} passes")
    return 0


class Frame:
    """A frame of `scenes.passes` and what it is measured against."""

    def __init__(self, first):
        paths = [
            first,
            first.with_name(first.name.replace(".a.", ".b.")),
            *(first.with_name(f"ref.{h}.exr") for h in "ab"),
        ]
        self.halves = paths[:2]
        self.channels = [read(path) for path in paths]
        cycles = "ViewLayer.Combined.R" in self.channels[0]
        self.layer = "ViewLayer." if cycles else ""
        self.features = [
            0.5 * (picture(self.channels[0], name, ends) + picture(self.channels[1], name, ends))
            for name, ends in (
                (("ViewLayer.Denoising Albedo", "RGB"), ("ViewLayer.Denoising Normal", "XYZ"))
                if cycles
                else (("albedo", "RGB"), ("normal", "XYZ"))
            )
        ]
        self.denoised = {}

    def four(self, name):
        """A layer of both halves and of both references."""
        return [picture(channels, name) for channels in self.channels]

    def oidn(self, name):
        """Open Image Denoise on one layer of the full buffer."""
        if name not in self.denoised:
            from pyoidn import denoise

            a, b, *_ = self.four(name)
            planes = [np.ascontiguousarray(np.moveaxis(p, 0, -1), np.float32) for p in (0.5 * (a + b), *self.features)]
            self.denoised[name] = np.moveaxis(denoise(*planes, hdr=True, quality="high"), -1, 0).astype(np.float64)
        return self.denoised[name]

    def measure(self, train, way, options):
        """A line of the table, and the ratios of every pass by set."""
        patterns = "auto" if self.layer else "light_*"
        with tempfile.TemporaryDirectory(prefix="bench-passes-") as out:
            command = [train, "fit", *self.halves, "--passes", patterns, "--passes-by", way, "-o", out, "--quiet"]
            subprocess.run([*map(str, command), *options.more.split()], check=True, env=environment(options))
            made, report = read(Path(out) / "corrected.exr"), json.loads((Path(out) / "report.json").read_text())
        beauty = f"{self.layer}Combined" if self.layer else ""
        of_beauty = ratio(picture(made, beauty), self.oidn(beauty), self.four(beauty))
        sets, words, sums = {}, [], []
        for entry in report["passes"]["sets"]:
            values = {}
            for name in entry["passes"]:
                four = self.four(name)
                if np.abs(four[2] + four[3]).mean() > 1e-6 and error(self.oidn(name), four) > 1e-9:
                    values[name.rpartition(".")[2]] = ratio(picture(made, name), self.oidn(name), four)
            sets[entry["what"]] = values
            words.append(f"{entry['what']} {geometric(values.values()):.2f}, {max(values.values()):.2f}")
            if entry["what"].startswith("light"):
                theirs = sum(self.oidn(name) for name in entry["passes"]) - self.oidn(beauty)
                sums.append(f"{np.abs(theirs).mean() / self.oidn(beauty).mean():.4f}")
        largest = report["passes"]["sum"]["largest_error"]
        seconds = f"{report['passes']['seconds']:.1f} of {report['seconds']['total']:.1f}"
        return f"{of_beauty:.2f} | {'; '.join(words)} | {', '.join(sums)} | {largest:.0e} | {seconds} |", sets


def read(path):
    import OpenEXR

    parts = OpenEXR.File(str(path), separate_channels=True).parts
    return {name: channel.pixels.astype(np.float64) for part in parts for name, channel in part.channels.items()}


def picture(channels, layer, ends="RGB"):
    """A layer as (3, height, width)."""
    return np.stack([channels[f"{layer}.{end}" if layer else end] for end in ends])


def error(picture, four):
    """relL2 against the mean of two references, their noise taken out."""
    _, _, a, b = four
    mean = 0.5 * (a + b)
    return np.mean(((picture - mean) ** 2 - ((a - b) / 2) ** 2) / (mean.mean(0) ** 2 + 0.01))


def ratio(picture, theirs, four):
    return error(picture, four) / error(theirs, four)


def geometric(values):
    return float(np.exp(np.mean(np.log(np.maximum(list(values), 1e-3)))))


def shown(values):
    return " ".join(f"{name} {value:.2f}" for name, value in values.items())
