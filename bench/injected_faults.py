"""Halves that are not what they claim to be: correlated noise and other faults, injected into real frames.

The new halves are denoised again with OIDN, as a renderer's would be; the full buffer's picture is denoised again where
the fault changes the mean. Every picture is compared with the denoiser's: none may come out worse than LIMIT.
"""

import json
import math
import subprocess
import sys
import tempfile
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from . import common, frames

# relL2 over the denoiser's that no fault may pass.
LIMIT = 1.02
CORRELATIONS = (-0.9, -0.8, -0.5, -0.29, -0.15, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.29, 0.5, 0.8, 0.95)
FAULTS = ("exposure", "white-balance", "filtered", "denoised", "full-buffer", "shifted")
# What a role may be called: root channels and those of a Cycles view layer.
ROLES = {
    "color": ("{}", "ViewLayer.Combined.{}", "RGB"),
    "albedo": ("albedo.{}", "ViewLayer.Denoising Albedo.{}", "RGB"),
    "normal": ("normal.{}", "ViewLayer.Denoising Normal.{}", "XYZ"),
    "visibility": ("visibility.{}", "visibility.{}", "Y"),
    "denoised": ("denoised.{}", "denoised.{}", "RGB"),
}
DESCRIPTION = """\
Injects correlations (--rho) and other faults (--fault) into the halves of every frame of a folder, denoises them again,
fits, and prints relL2 over the denoiser's, with a ! where it is above 1.02 and (d) where the denoiser's picture was the
answer. Needs what scenes/requirements.txt names (OIDN, OpenEXR) and target/release/sspc-train. Exit code 1 when a
picture is worse than the limit."""


def correlated(a, b, rho):
    """Halves of the same mean whose noise has correlation `rho`, of independent ones of equal noise."""
    if rho == 0:
        return a, b
    if rho > 0:
        # (1 - k) a + k b and k a + (1 - k) b: rho = 2 u / (1 - 2 u) with u = k (1 - k).
        k = 0.5 * (1 - math.sqrt(1 - 2 * rho / (1 + rho)))
        return (1 - k) * a + k * b, k * a + (1 - k) * b
    # a + k (a - b) and b - k (a - b): -rho = 2 v / (1 + 2 v) with v = k (1 + k).
    k = 0.5 * (math.sqrt(1 - 2 * rho / (1 + rho)) - 1)
    return a + k * (a - b), b - k * (a - b)


def filtered(image):
    """The mean of 3 x 3 pixels."""
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = image.shape[:2]
    return sum(padded[y : y + height, x : x + width] for y in range(3) for x in range(3)) / 9


def faulty(fault, a, b):
    """Half b with a fault, as new buffers; its denoised picture is made anew."""
    b = dict(b)
    if fault == "exposure":
        b["color"] = 1.2 * b["color"]
    elif fault == "white-balance":
        b["color"] = b["color"] * np.float32([1.12, 1, 0.88])
    elif fault == "filtered":
        b["color"] = filtered(b["color"])
    elif fault == "denoised":
        b["color"] = b["denoised"]
    elif fault == "full-buffer":
        b["color"] = 0.5 * (a["color"] + b["color"])
    elif fault == "shifted":
        b = {role: np.roll(image, 1, axis=1) for role, image in b.items()}
    return b


def read(path):
    """Planes (height, width, channels) by role."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}
    found = {}
    for role, (*patterns, components) in ROLES.items():
        for pattern in patterns:
            names = [pattern.format(component) for component in components]
            if all(name in channels for name in names):
                found.setdefault(role, np.stack([np.asarray(channels[name], np.float32) for name in names], -1))
    return found


def halves_of(frame):
    """Buffers of both halves and the full buffer's denoised picture."""
    halves = []
    for path, denoised in ((frame.a, frame.denoised_a), (frame.b, frame.denoised_b)):
        half = read(path)
        if denoised:
            half["denoised"] = read(denoised)["color"]
        halves.append(half)
    return (*halves, read(frame.denoised)["color"])


def injected(frame, what):
    """Halves with a correlation (a number) or a fault (its name), and the full buffer's denoised picture."""
    from scenes.frame import averaged, denoised

    a, b, full = halves_of(frame)
    if what == 0:
        return a, b, full
    if isinstance(what, float):
        a["color"], b["color"] = correlated(a["color"], b["color"], what)
        return a | {"denoised": denoised(a)}, b | {"denoised": denoised(b)}, full
    b = faulty(what, a, b)
    b["denoised"] = denoised(b)
    return a, b, denoised(averaged(*({role: half[role] for role in ("color", "albedo", "normal")} for half in (a, b))))


def measure(frame, what, program, options, environment):
    """relL2 over the denoiser's and whether that was the answer; None where the halves are refused."""
    from scenes.frame import write

    with tempfile.TemporaryDirectory(prefix="sspc-trust-") as scratch:
        folder = Path(scratch)
        a, b, full = injected(frame, what)
        write(folder / "a.exr", a)
        write(folder / "b.exr", b)
        write(folder / "denoised.exr", {"color": full})
        inputs = ["fit", "a.exr", "b.exr", "--denoised", "denoised.exr", "--reference", str(frame.reference.resolve())]
        command = [str(program), *inputs, "--preset", options.preset, "--seed", str(options.seed), "-q", "-o", "out"]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        if done.returncode:
            print(f"{frame.name}, {what}: {done.stderr.strip()}", file=sys.stderr)
            return None
        report = json.loads((folder / "out" / "report.json").read_text())
    errors = report["rel_l2"]
    return errors["corrected"] / errors["denoised"], "fallback" in report


def cell(result):
    """A figure of the table."""
    if result is None:
        return "refused"
    ratio, fell_back = result
    return f"{ratio:.3f}{' (d)' if fell_back else ''}{'!' if ratio > LIMIT else ''}"


def main(arguments=None):
    """The table, row by row; the exit code."""
    options = command_line().parse_args(arguments)
    found = [frame for frame in frames.find(options.frames) if frame.reference and frame.denoised and not frame.variant]
    found = [frame for frame in found if any(fnmatchcase(frame.name, glob) for glob in options.only)]
    columns, program = [*options.rho, *options.fault], common.program(options, "sspc-train")
    environment = common.environment(options)
    print("| frame | " + " | ".join(f"{c:+.2f}" if isinstance(c, float) else c for c in columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    worst = 0.0
    for frame in found:
        results = [measure(frame, what, program, options, environment) for what in columns]
        print(f"| {frame.name} | " + " | ".join(map(cell, results)) + " |", flush=True)
        worst = max([worst, *(result[0] for result in results if result)])
    print(f"\n`{options.preset}`, relL2 over the denoiser's; (d): the denoiser's was the answer; worst {worst:.3f}")
    return int(worst > LIMIT)


def command_line():
    """The options."""
    made = common.parser("bench/trust", DESCRIPTION)
    made.add_argument("frames", type=common.folder, help="folder of scenes, as bench/run takes it")
    made.add_argument("--only", nargs="+", default=["*"], metavar="GLOB", help="frames by name, e.g. 'staircase/*'")
    made.add_argument("--rho", nargs="*", type=float, default=list(CORRELATIONS), help="correlations, -0.9 to 0.95")
    made.add_argument("--fault", nargs="*", choices=FAULTS, default=list(FAULTS), help="other faults of half b")
    made.add_argument("--preset", default="fast")
    made.add_argument("--seed", type=int, default=1)
    return made
