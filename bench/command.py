"""The command line and the loop over the jobs."""

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from datetime import datetime, timezone
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from . import ablations, derived, frames, jobs, machine, runs
from .record import Record, free_stem, name_of, table, write_all

REPOSITORY = Path(__file__).resolve().parents[1]
DESCRIPTION = """\
Fits every frame with every preset, file to file, checks every answer with sspc-infer, and writes a dated record
(tables, JSON, plots). The programs are those of target/release (or $CARGO_TARGET_DIR): build them first,
`cargo build --release --workspace --bins --examples`. The frame in the repository is always measured; --frames adds
a folder of scenes, whose file names are told in bench/frames.py, and a frame of 1280 x 720 made of one of
them. Exit codes: 0 done, 1 a run failed or its answer was wrong (the record says which), 2 bad arguments, 130
interrupted (what was measured is kept)."""


def main(arguments=None):
    options = command_line().parse_args(arguments)
    try:
        known = frames.render_seconds(options.frames) if options.frames else {}
    except ValueError as why:
        fail(str(why))
    programs = find_programs(options)
    if options.pin:
        os.sched_setaffinity(0, options.pin)
    found = frames.sample(REPOSITORY) + (frames.find(options.frames) if options.frames else [])
    found = [frame for frame in found if any(fnmatchcase(frame.name, glob) for glob in options.only)]
    for name in set(dict(options.render_seconds)) - {frame.name for frame in found}:
        print(f"bench: --render-seconds: no frame {name} is measured", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix="sspc-bench-") as scratch:
        options.render_seconds = [*known.items(), *options.render_seconds]  # what the command line says comes last and wins
        measure = ablate if options.ablations else compare
        return measure(found, programs, options, arguments, Path(scratch))


def compare(found, programs, options, arguments, scratch):
    """Methods and presets on every frame, and their record; the exit code."""
    problems = []
    if options.crops:
        cut = [derive(partial(derived.quarter, index=index), frame, programs, scratch, problems) for frame in found for index in range(4)]
        found = [quarter for quarters in cut for quarter in quarters]
    elif options.frames and options.large:
        found = found + derive(derived.fourfold, derived.source(found), programs, scratch, problems)
    methods = jobs.methods(
        options.methods, options.presets, options.method, options.steps,
        options.paper_frames, options.torch_frames, options.torch_timeout,
    )  # fmt: skip
    todo = jobs.jobs(found, methods, options.seeds, options.repeat)
    results, about = run_all(todo, found, programs, options, arguments, scratch, problems)
    columns = list(dict.fromkeys((jobs.column(m.name, p), m.name, p) for m in methods for p in m.presets))
    record = Record(about, found, columns, cleaned(results, options), dict(options.render_seconds).get)
    for path in record.write(options.output):
        say(f"wrote {path}")
    return conclude(record, about["ended"])


def ablate(found, programs, options, arguments, scratch):
    """One preset with one thing changed at a time, and the record; the exit code."""
    problems, chosen = [], ablations.chosen(found)
    made = [(frame.name, derive(derived.half_empty, frame, programs, scratch, problems)) for frame in chosen]
    half_empty = {name: copy for name, copies in made for copy in copies}
    todo = ablations.jobs(chosen, half_empty, options.ablations, options.seeds, options.steps)
    results, about = run_all(todo, found, programs, options, arguments, scratch, problems)
    record = Record(about, found, [], cleaned(results, options), lambda _: None)
    done = ablations.Ablations(about, chosen, half_empty, options.ablations, record.results)
    stem = free_stem(options.output, f"{name_of(about)}-ablations")
    texts = {f"{stem}.md": done.markdown([part for part in (record.failures(), record.about_text()) if part], table), f"{stem}.json": done.json()}
    for path in write_all(options.output, texts):
        say(f"wrote {path}")
    return conclude(record, about["ended"])


def derive(make, source, programs, scratch, problems):
    """[the frame made of `source`], or [] and a problem for the record, told once."""
    try:
        return [make(source, programs.edit, scratch / "frames")] if source else []
    except derived.NoTool as why:
        problems += [problem for problem in (f"a frame is lacking: {why}",) if problem not in problems]
        return []


def run_all(todo, found, programs, options, arguments, scratch, problems):
    """Runs the jobs; their results, and what the record says of commit, machine, programs and how it ended."""
    if not todo:
        fail("nothing to run: no frame matches, or no preset or method was asked for")
    head = machine.commit(REPOSITORY)
    measured = [path for path in (programs.train, programs.infer) if path]
    about = {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "commit": head,
        "programs": [machine.program(path, head) for path in measured],
        "machine": machine.machine(options.threads),
        "command": shown(sys.argv[1:] if arguments is None else arguments),
        "steps_limit": options.steps,
        "seeds": options.seeds,
        "planned": len(todo),
        "problems": problems,
    }
    for program in about["programs"]:
        if program["older_than_commit"]:
            about["problems"].append(f"{program['name']} was built before the commit named here")
    say(f"{len(todo)} runs on {len(found)} frames; threads: {options.threads or 'one a usable core'}")
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
    results, ended = carry_out(todo, programs, options, scratch)
    for path, program in zip(measured, about["programs"]):
        if not machine.unchanged(path, program):
            about["problems"].append(f"{program['name']} was rebuilt while it was measured")
    return results, about | {"ended": ended, "load_average_after": machine.load()}


def shown(arguments):
    """The command without the folders of this machine that decide nothing."""
    words, left_out = [], False
    for word in arguments:
        name, mark, _ = word.partition("=")
        local = name in ("--bin-dir", "--keep", "-o", "--output")
        if not local and not left_out:
            words.append(word)
        left_out = local and not mark
    return shlex.join(["bench/run", *words])


def command_line():
    parser = argparse.ArgumentParser(
        prog="bench/run", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=folder, metavar="DIR", help="folder of scenes, measured besides the repository's frame")
    parser.add_argument("--only", type=names, default=("*",), metavar="GLOB,GLOB", help="frames to measure, by name, e.g. 'staircase/*,sample'")
    presets = ("fast", "balanced", "quality")
    parser.add_argument("--presets", type=names, default=presets, metavar="A,B", help="presets to run, 'none' for none (default: all three)")
    parser.add_argument("--methods", type=method_names, default=("sspc", "fc"), metavar="A,B",
                        help="sspc: the presets; fc: f_c with the network and steps of balanced; paper: the preset paper (minutes a frame); "
                        "torch: PyTorch with the paper's schedule (many minutes a frame); default sspc,fc")
    parser.add_argument("--paper-frames", type=names, default=("sample", "staircase/64spp"), metavar="GLOB,GLOB",
                        help="frames that the preset paper is run on (default sample,staircase/64spp)")
    parser.add_argument("--torch-frames", type=names, default=("sample",), metavar="GLOB,GLOB", help="frames that PyTorch is run on (default sample)")
    parser.add_argument("--torch-timeout", type=positive, default=3600, metavar="SECONDS", help="a PyTorch run that lasts longer failed (default 3600)")
    parser.add_argument("--no-large", dest="large", action="store_false", help="without the frame of 1280 x 720")
    parser.add_argument("--crops", action="store_true", help="instead of the frames their quarters, each a picture of its own: does one come out worse?")
    parser.add_argument("--ablations", choices=presets, metavar="PRESET",
                        help="instead of methods and presets: this preset with one thing changed at a time, on every frame as denoised "
                        "(of a shot, the first), and a record of its own")
    parser.add_argument("--method", type=named, action="append", default=[], metavar="NAME=ARGUMENTS",
                        help="also sspc-train fit with these arguments, e.g. 'no albedo=--role albedo=none', with every preset; repeatable")
    parser.add_argument("--seeds", type=numbers, default=[1], metavar="1,2", help="seeds (default 1)")
    parser.add_argument("--repeat", type=positive, default=1, metavar="N", help="times each run is made; the median of the seconds counts")
    parser.add_argument("--threads", type=positive, metavar="N", help="threads a run may use (default: one a usable core)")
    parser.add_argument("--pin", type=numbers, metavar="0,1", help="cores to run on (Linux)")
    parser.add_argument("--render-seconds", type=seconds_of, action="append", default=[], metavar="FRAME=SECONDS",
                        help="render time of a frame, for equal-time figures; repeatable. Folders may tell theirs: bench/frames.py")
    parser.add_argument("--steps", type=positive, metavar="N", help="a trial: N steps a fit (PyTorch: one epoch); goals are not judged")
    parser.add_argument("--timeout", type=positive, default=3600, metavar="SECONDS", help="a run that lasts longer failed (default 3600)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep every run's pictures and reports in this folder")
    parser.add_argument("--bin-dir", type=folder, metavar="DIR", help="folder of sspc-train and sspc-infer")
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "bench" / "records", metavar="DIR",
                        help="folder of the records (default bench/records)")
    return parser


def folder(value):
    path = Path(value)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{value} is not a folder")
    return path


def names(value):
    return () if value == "none" else tuple(name for name in value.split(",") if name)


def method_names(value):
    unknown = set(names(value)) - set(jobs.NAMES)
    if unknown:
        raise argparse.ArgumentTypeError(f"no method {', '.join(sorted(unknown))}; there are {', '.join(jobs.NAMES)}")
    return names(value)


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
    if "torch" in options.methods and not options.ablations:
        named_python = os.environ.get("SSPC_PYTHON_VENV")
        done = None if named_python else subprocess.run([REPOSITORY / ".ci" / "setup-python"], stdout=subprocess.PIPE, text=True)
        if done and done.returncode:
            fail("--torch needs the virtual environment of reference-py, and it could not be made")
        python = Path(named_python or done.stdout.strip())
    edit = binaries / "examples" / "edit_exr"
    return runs.Programs(binaries / "sspc-train", binaries / "sspc-infer", edit, python, REPOSITORY / "reference-py")


def carry_out(todo, programs, options, scratch):
    """Runs the jobs; results so far and how it ended. Ctrl-C and SIGTERM end it and keep what was measured."""
    environment = dict(os.environ)
    if options.threads:
        environment["RAYON_NUM_THREADS"] = str(options.threads)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    results, done = [], []
    try:
        for index, job in enumerate(todo):
            begin = time.perf_counter()
            place = (options.keep or scratch) / output_name(job)
            result = runs.run_job(job, programs, place.resolve(), environment, job.method.limit or options.timeout)
            if not result["failure"]:
                result["failure"] = runs.repeats_agree(result, results)
            results.append(result)
            done.append((job.column, time.perf_counter() - begin))
            left = jobs.seconds_left(done, [later.column for later in todo[index + 1 :]])
            say(f"[{index + 1}/{len(todo)}] {line(result)}; {duration(left)} left", loud=bool(result["failure"]))
            if not options.keep:
                shutil.rmtree(place, ignore_errors=True)
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
