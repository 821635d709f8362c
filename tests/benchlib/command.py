"""The command line and the loop over the jobs."""

import argparse
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from datetime import datetime, timezone
from fnmatch import fnmatchcase
from pathlib import Path

from . import frames, jobs, machine, runs
from .record import Record

REPOSITORY = Path(__file__).resolve().parents[2]
DESCRIPTION = """\
Fits every frame with every preset, file to file, checks every answer with sspc-infer, and writes a dated record
(tables, JSON, plot). The programs are those of target/release (or $CARGO_TARGET_DIR): build them first,
`cargo build --release`. The frame in the repository is always measured; --frames adds a folder of scenes, whose
file names are told in tests/benchlib/frames.py. Exit codes: 0 done, 1 a run failed or its answer was wrong (the
record says which), 2 bad arguments, 130 interrupted (what was measured is kept)."""


def main(arguments=None):
    options = command_line().parse_args(arguments)
    render_seconds = dict(options.render_seconds)
    programs = find_programs(options)
    if options.pin:
        os.sched_setaffinity(0, options.pin)
    found = frames.sample(REPOSITORY) if fnmatchcase(frames.SAMPLE, options.only) else []
    found += frames.find(options.frames, options.only) if options.frames else []
    methods = jobs.methods(options.presets, options.paper, options.torch, options.method, options.steps)
    todo = jobs.jobs(found, methods, options.seeds, options.repeat)
    if not todo:
        fail("nothing to run: no frame matches, or no preset or method was asked for")
    for name in set(render_seconds) - {frame.name for frame in found}:
        print(f"bench: --render-seconds: no frame {name} is measured", file=sys.stderr)

    head = machine.commit(REPOSITORY)
    measured = [path for path in (programs.train, programs.infer) if path]
    about = {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "commit": head,
        "programs": [machine.program(path, head) for path in measured],
        "machine": machine.machine(options.threads),
        "command": shlex.join(["tests/bench", *(sys.argv[1:] if arguments is None else arguments)]),
        "steps_limit": options.steps,
        "seeds": options.seeds,
        "planned": len(todo),
        "problems": [],
    }
    for program in about["programs"]:
        if program["older_than_commit"]:
            about["problems"].append(f"{program['name']} was built before the commit named here")
    say(f"{len(todo)} runs on {len(found)} frames; threads: {options.threads or 'one a usable core'}")
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
    results, ended = carry_out(todo, programs, options)
    for path, program in zip(measured, about["programs"]):
        if not machine.unchanged(path, program):
            about["problems"].append(f"{program['name']} was rebuilt while it was measured")
    about |= {"ended": ended, "load_average_after": machine.load()}

    columns = list(dict.fromkeys((jobs.column(m.name, p), m.name, p) for m in methods for p in m.presets))
    record = Record(about, found, columns, cleaned(results, options), render_seconds.get)
    for path in record.write(options.output):
        say(f"wrote {path}")
    return conclude(record, ended)


def command_line():
    parser = argparse.ArgumentParser(
        prog="tests/bench", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=folder, metavar="DIR", help="folder of scenes, measured besides the repository's frame")
    parser.add_argument("--only", default="*", metavar="GLOB", help="frames to measure, by name, e.g. 'staircase/*' or sample")
    presets = ("fast", "balanced", "quality")
    parser.add_argument("--presets", type=names, default=presets, metavar="A,B", help="presets to run, 'none' for none (default: all three)")
    parser.add_argument("--paper", action="store_true", help="also the preset paper (minutes a frame)")
    parser.add_argument("--torch", action="store_true", help="also PyTorch with the paper's schedule (many minutes a frame)")
    parser.add_argument("--method", type=named, action="append", default=[], metavar="NAME=ARGUMENTS",
                        help="also sspc-train fit with these arguments, e.g. 'no albedo=--role albedo=none', with every preset; repeatable")
    parser.add_argument("--seeds", type=numbers, default=[1], metavar="1,2", help="seeds (default 1)")
    parser.add_argument("--repeat", type=positive, default=1, metavar="N", help="times each run is made; the median of the seconds counts")
    parser.add_argument("--threads", type=positive, metavar="N", help="threads a run may use (default: one a usable core)")
    parser.add_argument("--pin", type=numbers, metavar="0,1", help="cores to run on (Linux)")
    parser.add_argument("--render-seconds", type=seconds_of, action="append", default=[], metavar="FRAME=SECONDS",
                        help="render time of a frame, for equal-time figures; repeatable")
    parser.add_argument("--steps", type=positive, metavar="N", help="a trial: N steps a fit (PyTorch: one epoch); goals are not judged")
    parser.add_argument("--timeout", type=positive, default=3600, metavar="SECONDS", help="a run that lasts longer failed (default 3600)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep every run's pictures and reports in this folder")
    parser.add_argument("--bin-dir", type=folder, metavar="DIR", help="folder of sspc-train and sspc-infer")
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "tests" / "records", metavar="DIR",
                        help="folder of the records (default tests/records)")
    return parser


def folder(value):
    path = Path(value)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{value} is not a folder")
    return path


def names(value):
    return () if value == "none" else tuple(name for name in value.split(",") if name)


def numbers(value):
    return [int(part) for part in value.split(",")]


def positive(value):
    if int(value) < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a number above 0")
    return int(value)


def named(value):
    name, mark, arguments = value.partition("=")
    if not mark or not name:
        raise argparse.ArgumentTypeError(f"'{value}' is not NAME=ARGUMENTS")
    return name, tuple(shlex.split(arguments))


def seconds_of(value):
    name, mark, seconds = value.rpartition("=")
    if not mark or not float(seconds) > 0:
        raise argparse.ArgumentTypeError(f"'{value}' is not FRAME=SECONDS")
    return name, float(seconds)


def find_programs(options):
    target = Path(os.environ.get("CARGO_TARGET_DIR") or REPOSITORY / "target")
    binaries = (options.bin_dir or target / "release").resolve()
    for name in ("sspc-train", "sspc-infer"):
        if not (binaries / name).is_file():
            fail(f"no {binaries / name}; run `cargo build --release`, or say --bin-dir")
    python = None
    if options.torch:
        named_python = os.environ.get("SSPC_PYTHON_VENV")
        done = None if named_python else subprocess.run([REPOSITORY / ".ci" / "setup-python"], stdout=subprocess.PIPE, text=True)
        if done and done.returncode:
            fail("--torch needs the virtual environment of reference-py, and it could not be made")
        python = Path(named_python or done.stdout.strip())
    return runs.Programs(binaries / "sspc-train", binaries / "sspc-infer", python, REPOSITORY / "reference-py")


def carry_out(todo, programs, options):
    """Runs the jobs; results so far and how it ended. Ctrl-C and SIGTERM end it and keep what was measured."""
    environment = dict(os.environ)
    if options.threads:
        environment["RAYON_NUM_THREADS"] = str(options.threads)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    results, done = [], []
    try:
        with tempfile.TemporaryDirectory(prefix="sspc-bench-") as scratch:
            for index, job in enumerate(todo):
                begin = time.perf_counter()
                place = (options.keep or Path(scratch)) / output_name(job)
                result = runs.run_job(job, programs, place.resolve(), environment, options.timeout)
                if not result["failure"]:
                    result["failure"] = runs.repeats_agree(result, results)
                results.append(result)
                done.append((job.column, time.perf_counter() - begin))
                left = jobs.seconds_left(done, [later.column for later in todo[index + 1 :]])
                say(f"[{index + 1}/{len(todo)}] {line(result)}; {duration(left)} left", loud=bool(result["failure"]))
    except KeyboardInterrupt:
        say("interrupted: keeping what was measured", loud=True)
        return results, "interrupted"
    return results, "ran to its end"


def output_name(job):
    parts = (job.frame.name, job.column, f"seed{job.seed}", f"run{job.repeat + 1}")
    return "-".join(parts).replace("/", "-").replace(" ", "-").replace(",", "")


def line(result):
    start = f"{result['frame']}, {result['column']}, seed {result['seed']}: "
    if result["failure"]:
        return f"{start}FAILED: {result['failure']}"
    known = result.get("rel_l2")
    ratio = f"{known['corrected'] / known['denoised']:.3f} of the denoiser's, " if known and known["denoised"] else "no reference, "
    threads = f", {result['threads']} threads" if result.get("threads") else ""
    return f"{start}{ratio}{result['wall_seconds']:.2f} s, {result['peak_rss_bytes'] / 2**20:.0f} MiB{threads}"


def duration(seconds):
    if seconds is None or seconds < 90:
        return f"{seconds or 0:.0f} s"
    return f"{seconds / 60:.0f} min"


def cleaned(results, options):
    """Results without the folders of this machine: a record is made to be shared."""
    hidden = [(str(path.resolve()) + "/", "") for path in (options.frames, options.keep, REPOSITORY) if path]
    if options.frames:
        hidden.append((f"{options.frames}/", ""))
    hidden.append((tempfile.gettempdir() + "/", ""))

    def clean(value):
        if isinstance(value, str):
            for path, name in hidden:
                value = value.replace(path, name)
            return value
        if isinstance(value, dict):
            return {key: clean(item) for key, item in value.items()}
        return [clean(item) for item in value] if isinstance(value, list) else value

    return clean(results)


def conclude(record, ended):
    """Says what counts and returns the exit code."""
    for preset in record.rated():
        for verdict in record.verdicts(preset):
            say(f"{preset}: {verdict.what} {verdict.goal}: {verdict.found}, {verdict.word.strip('*')}")
    failed = [result for result in record.results if result["failure"]]
    for problem in record.about["problems"]:
        say(f"WARNING: {problem}", loud=True)
    if failed:
        say(f"{len(failed)} of {len(record.results)} runs FAILED; the record names them", loud=True)
    if ended == "interrupted":
        return 130
    return 1 if failed else 0


def say(words, loud=False):
    print(words, file=sys.stderr if loud else sys.stdout, flush=True)


def fail(words):
    print(f"bench: {words}", file=sys.stderr)
    raise SystemExit(2)
