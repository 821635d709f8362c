"""The command line: makes large frames of a small one, fits and corrects each, measures the whole processes."""

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from datetime import datetime, timezone
from pathlib import Path

from .. import machine
from ..runs import Failed, checked_process, measured

from . import record

REPOSITORY = Path(__file__).resolve().parents[2]
DESCRIPTION = """\
Mirrors a frame on and on until it fills each size, runs `sspc-train fit --preset fast --time-limit 60` and
`sspc-infer run` on it, file to file, and writes a dated record (table, JSON, plot) of wall time, time of all cores
and peak memory. The model that `run` uses is the one fitted on the smallest frame. Programs are those of
target/release (or $CARGO_TARGET_DIR), the frames are made by an example: build both first,
`cargo build --release --workspace --bins --examples`. 8K takes 4 GB of disk and, for fit, 7 GB of memory.
Exit codes: 0 done, 1 a run failed or took more memory than it may, 2 bad arguments,
130 interrupted (what was measured is kept)."""

# Longest run of one program: an 8K fit reads and corrects for minutes beside its time limit.
TIMEOUT = 3600


def main(arguments=None):
    options = command_line().parse_args(arguments)
    programs = {name: find_program(options, name) for name in ("sspc-train", "sspc-infer", "examples/edit_exr")}
    head = machine.commit(REPOSITORY)
    about = {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "commit": head,
        "programs": [machine.program(programs[name], head) for name in ("sspc-train", "sspc-infer")],
        "machine": machine.machine(options.threads),
        "command": shlex.join(["bench/scale", *(sys.argv[1:] if arguments is None else arguments)]),
        "time_limit": options.time_limit,
    }
    environment = dict(os.environ)
    if options.threads:
        environment["RAYON_NUM_THREADS"] = str(options.threads)
    results, interrupted = [], False
    with tempfile.TemporaryDirectory(prefix="sspc-scale-", dir=options.scratch) as scratch:
        try:
            carry_out(options, programs, environment, Path(scratch), results)
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
    parser = argparse.ArgumentParser(
        prog="bench/scale", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frame", type=existing, nargs=3, metavar=("A", "B", "DENOISED"), help="the frame to repeat: both halves and the full buffer's denoised picture (default: the one in the repository)",
                        default=[REPOSITORY / "tests" / "data" / "sample" / name for name in ("a.exr", "b.exr", "denoised.exr")])
    parser.add_argument("--sizes", type=sizes, default=sizes("1280x720,2560x1440,3840x2160,7680x4320"), metavar="WxH,WxH",
                        help="sizes (default 1280x720,2560x1440,3840x2160,7680x4320)")
    parser.add_argument("--programs", type=lambda value: value.split(","), default=["fit", "run"], metavar="fit,run", help="what to run (default both)")
    parser.add_argument("--model", type=existing, metavar="model.onnx", help="the model of run, needed without fit")
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="SECONDS", help="of training (default 60)")
    parser.add_argument("--threads", type=int, metavar="N", help="threads a run may use (default: one a usable core)")
    parser.add_argument("--scratch", metavar="DIR", help="folder for the large frames (default: the system's temporary one)")
    parser.add_argument("--bin-dir", type=existing, metavar="DIR", help="folder of the programs")
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "bench" / "records", metavar="DIR",
                        help="folder of the record (default bench/records)")
    return parser


def existing(value):
    path = Path(value)
    if not path.exists():
        raise argparse.ArgumentTypeError(f"no {value}")
    return path.resolve()


def sizes(value):
    found = [tuple(int(side) for side in part.split("x")) for part in value.split(",")]
    if any(len(size) != 2 or min(size) < 1 for size in found):
        raise argparse.ArgumentTypeError(f"{value} is not WxH,WxH")
    return found


def find_program(options, name):
    target = Path(os.environ.get("CARGO_TARGET_DIR") or REPOSITORY / "target")
    path = (options.bin_dir or target / "release").resolve() / name
    if not path.is_file():
        sys.exit(f"scale: no {path}; run `cargo build --release --workspace --bins --examples`, or say --bin-dir")
    return path


def enlarged(edit, frame, size, scratch):
    """The frame's three files at a size, made of mirrored copies."""
    names = ("a", "b", "denoised")
    paths = {name: scratch / f"{name}.exr" for name in names}
    for name, source in zip(names, frame):
        subprocess.run([edit, "mirror", source, paths[name], *map(str, size)], check=True)
    return paths


def line(programs, name, frame, out, model, options):
    """The command of one run."""
    files = [frame["a"], frame["b"], "--denoised", frame["denoised"]]
    if name == "fit":
        limits = ["--preset", "fast", "--time-limit", str(options.time_limit)]
        return [programs["sspc-train"], "fit", *files, *limits, "--quiet", "-o", out]
    if not model:
        sys.exit("scale: run needs --model where nothing is fitted")
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
