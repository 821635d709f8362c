"""The command line of bench/scale: enlarges a frame, fits and corrects it, measures the whole processes."""

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from .. import common, derived, machine
from ..runs import Failed, checked_process, measured
from . import record

PROG = "bench/scale"
DESCRIPTION = f"""\
Enlarges a frame to each size with mirrored copies, runs `sspc-train fit --preset fast --time-limit 60` and
`sspc-infer run` on it, file to file, and writes a dated record (table, JSON, plot) of wall time, processor time and
peak memory. `run` uses the model fitted on the smallest frame. Build the programs first:
`{common.BUILD}`. 8K takes 4 GB of disk and, for fit, 7 GB of memory.
Exit codes: 0 done, 1 a run failed or exceeded its memory bound, 2 bad arguments, 130 interrupted (what was measured is
kept)."""

# Longest run of one program in seconds: an 8K fit reads and corrects for minutes beside its time limit.
TIMEOUT = 3600
SAMPLE = common.REPOSITORY / "tests" / "data" / "sample"


def main(arguments=None):
    options = command_line().parse_args(arguments)
    programs = {name: common.program(options, name) for name in ("sspc-train", "sspc-infer", "examples/edit_exr")}
    about = common.about(PROG, arguments, options, [programs["sspc-train"], programs["sspc-infer"]])
    about["time_limit"] = options.time_limit
    results, interrupted = [], False
    with tempfile.TemporaryDirectory(prefix="sspc-scale-", dir=options.scratch) as scratch:
        try:
            carry_out(options, programs, common.environment(options), Path(scratch), results)
        except KeyboardInterrupt:
            print("interrupted: keeping what was measured", file=sys.stderr)
            interrupted = True
    about["load_average_after"] = machine.load()
    for path in record.write(options.output, about, results) if results else []:
        print(f"wrote {path}", file=sys.stderr)
    if interrupted:
        return 130
    return 1 if any(result["failure"] or record.too_much(result) for result in results) else 0


def carry_out(options, programs, environment, scratch, results):
    """Measures every size, small ones first; appends to `results` as they come."""
    model = options.model
    for size in sorted(options.sizes, key=lambda size: size[0] * size[1]):
        frame = enlarged(programs["examples/edit_exr"], options.frame, size, scratch)
        for name in options.programs:
            out = scratch / f"{name}-out"
            command = line(programs, name, frame, out, model, options)
            results.append(measure(name, size, command, environment, out))
            print(record.sentence(results[-1]), file=sys.stderr, flush=True)
            if name == "fit" and not results[-1]["failure"]:
                model = model or kept(out / "model.onnx", scratch)
            shutil.rmtree(out, ignore_errors=True)
        for path in frame.values():
            path.unlink()


def command_line():
    parser = common.parser(PROG, DESCRIPTION)
    common.add_output(parser)
    parser.add_argument(
        "--frame",
        type=common.existing,
        nargs=3,
        metavar=("A", "B", "DENOISED"),
        help="frame to repeat: both halves and the denoised full buffer (default: the one in the repository)",
        default=[SAMPLE / name for name in ("a.exr", "b.exr", "denoised.exr")],
    )
    sizes = "1280x720,2560x1440,3840x2160,7680x4320"
    parser.add_argument("--sizes", type=common.sizes, default=sizes, metavar="WxH,WxH", help=f"default {sizes}")
    parser.add_argument("--programs", type=programs_of, default="fit,run", metavar="fit,run", help="default both")
    parser.add_argument("--model", type=common.existing, metavar="model.onnx", help="model for run, needed without fit")
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="SECONDS", help="of training (default 60)")
    parser.add_argument("--scratch", metavar="DIR", help="folder for the large frames (default: the temporary folder)")
    return parser


def programs_of(value):
    found = value.split(",")
    if set(found) - {"fit", "run"}:
        raise argparse.ArgumentTypeError(f"{value} is not fit, run or fit,run")
    return found


def enlarged(edit, frame, size, scratch):
    """The frame's three files at a size (width, height), made of mirrored copies."""
    paths = {name: scratch / f"{name}.exr" for name in ("a", "b", "denoised")}
    for path, source in zip(paths.values(), frame):
        derived.mirror(edit, source, path, *size)
    return paths


def line(programs, name, frame, out, model, options):
    """The command of one run."""
    files = [frame["a"], frame["b"], "--denoised", frame["denoised"]]
    if name == "fit":
        limits = ["--preset", "fast", "--time-limit", str(options.time_limit)]
        return [programs["sspc-train"], "fit", *files, *limits, "--quiet", "-o", out]
    if not model:
        common.fail("run needs --model where nothing is fitted")
    out.mkdir()
    return [programs["sspc-infer"], "run", "--model", model, *files, "--json", "--quiet", "-o", out / "corrected.exr"]


def measure(name, size, command, environment, out):
    width, height = size
    result = {"program": name, "width": width, "height": height, "failure": None}
    try:
        result |= measured(checked_process(name, [str(part) for part in command], environment, TIMEOUT))
        report = out / ("report.json" if name == "fit" else "corrected.json")
        result |= {key: value for key, value in json.loads(report.read_text()).items() if key in ("seconds", "steps")}
    except (Failed, OSError, ValueError) as error:
        result["failure"] = str(error)
    return result


def kept(model, scratch):
    """A copy of the model outside the folder that is removed."""
    path = scratch / "model.onnx"
    path.write_bytes(model.read_bytes())
    return path
