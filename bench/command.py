"""The command line of bench/run and its loop over the jobs."""

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from . import ablations, common, derived, frames, jobs, machine, runs, shots
from .common import REPOSITORY, fail
from .record import Record, free_stem, name_of, table, write_all

PROG = "bench/run"
PRESETS = ("fast", "balanced", "quality")
DESCRIPTION = f"""\
Fits every frame with every preset, file to file, checks every answer with sspc-infer, and writes a dated record
(tables, JSON, plots). Build the programs first: `{common.BUILD}`.
The frame in the repository is always measured. --frames adds a folder of scenes (bench/frames.py lists the file names)
and one frame of 1280 x 720 derived from them. Exit codes: 0 done, 1 a run failed or its answer was wrong (the record
says which), 2 bad arguments, 130 interrupted (what was measured is kept)."""


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
        print(f"bench: --render-seconds: frame {name} is not measured", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix="sspc-bench-") as scratch:
        # Later entries win: the command line overrides the folders' own.
        options.render_seconds = [*known.items(), *options.render_seconds]
        measure = ablate if options.ablations else compare
        return measure(found, programs, options, arguments, Path(scratch))


def compare(found, programs, options, arguments, scratch):
    """Measures methods and presets on every frame and writes the record; returns the exit code."""
    problems = []
    if options.crops:
        cuts = [(frame, partial(derived.quarter, index=index)) for frame in found for index in range(4)]
        found = [crop for frame, cut in cuts for crop in derive(cut, frame, programs, scratch, problems)]
    elif options.frames and options.large:
        found = found + derive(derived.fourfold, derived.source(found), programs, scratch, problems)
    methods = jobs.methods(
        options.methods, options.presets, options.method, options.steps,
        options.paper_frames, options.torch_frames, options.torch_timeout,
    )  # fmt: skip
    todo = jobs.jobs(found, methods, options.seeds, options.repeat)
    wholes = shots.of(found) if options.shots and not options.crops else []
    results, of_shots, about = run_all(todo, found, programs, options, arguments, scratch, problems, wholes)
    columns = list(dict.fromkeys((jobs.column(m.name, p), m.name, p) for m in methods for p in m.presets))
    known, of_shots = dict(options.render_seconds).get, cleaned(of_shots, options)
    record = Record(about, found, columns, cleaned(results, options), known, of_shots)
    for path in record.write(options.output):
        say(f"wrote {path}")
    return conclude(record, about["ended"])


def ablate(found, programs, options, arguments, scratch):
    """Measures a preset with one setting changed at a time and writes the record; returns the exit code."""
    problems, chosen = [], ablations.chosen(found)
    made = [(frame.name, derive(derived.half_empty, frame, programs, scratch, problems)) for frame in chosen]
    half_empty = {name: copy for name, copies in made for copy in copies}
    todo = ablations.jobs(chosen, half_empty, options.ablations, options.seeds, options.steps)
    results, _, about = run_all(todo, found, programs, options, arguments, scratch, problems)
    record = Record(about, found, [], cleaned(results, options), lambda _: None)
    done = ablations.Ablations(about, chosen, half_empty, options.ablations, record.results)
    stem = free_stem(options.output, f"{name_of(about)}-ablations")
    texts = {
        f"{stem}.md": done.markdown([part for part in (record.failures(), record.about_text()) if part], table),
        f"{stem}.json": done.json(),
    }
    for path in write_all(options.output, texts):
        say(f"wrote {path}")
    return conclude(record, about["ended"])


def derive(make, source, programs, scratch, problems):
    """[the frame derived from `source`], or [] and one entry in `problems`."""
    try:
        return [make(source, programs.edit, scratch / "frames")] if source else []
    except derived.NoTool as why:
        problems += [problem for problem in (f"a frame is missing: {why}",) if problem not in problems]
        return []


def run_all(todo, found, programs, options, arguments, scratch, problems, wholes=()):
    """Runs the jobs, then the shots as wholes; returns the results of both and what the record states about the run."""
    if not todo and not wholes:
        fail("nothing to run: no frame matches, or no preset or method was given")
    measured = [programs.train, programs.infer]
    about = common.about(PROG, arguments, options, measured) | {
        "steps_limit": options.steps,
        "seeds": options.seeds,
        "planned": len(todo) + len(wholes) * len(options.shots) * len(options.seeds) * len(shots.WAYS),
        "problems": problems,
    }
    for program in about["programs"]:
        if program["older_than_commit"]:
            about["problems"].append(f"{program['name']} was built before the commit named here")
    threads = options.threads or "one per usable core"
    say(f"{len(todo)} runs on {len(found)} frames, then {len(wholes)} shots as wholes; threads: {threads}")
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
    results, ended = carry_out(todo, programs, options, scratch)
    of_shots = []
    if wholes and ended != "interrupted":
        setting = shots.Setting(programs, common.environment(options), options.timeout, options.steps)
        of_shots, ended = shots.measure(wholes, options.shots, options.seeds, setting, scratch, options.keep, say)
    for path, program in zip(measured, about["programs"]):
        if not machine.unchanged(path, program):
            about["problems"].append(f"{program['name']} was rebuilt while it was measured")
    return results, of_shots, about | {"ended": ended, "load_average_after": machine.load()}


def command_line():
    parser = common.parser(PROG, DESCRIPTION)
    common.add_output(parser)

    def option(name, help, **settings):
        parser.add_argument(name, help=help, **settings)

    option("--frames", "folder of scenes to measure as well", type=common.folder, metavar="DIR")
    option("--only", "frames to measure, e.g. 'staircase/*,sample'", type=names, default=("*",), metavar="GLOB,GLOB")
    option("--presets", "presets to run, or none (default: all three)", type=names, default=PRESETS, metavar="A,B")
    option(
        "--methods",
        "sspc: the presets; fc: f_c with the network and steps of balanced; paper: the preset paper (minutes per "
        "frame); torch: PyTorch with the paper's schedule (many minutes per frame); default sspc,fc",
        type=method_names,
        default=("sspc", "fc"),
        metavar="A,B",
    )
    paper_frames, torch_frames = ("sample", "staircase/64spp"), ("sample",)
    option("--paper-frames", "frames for paper", type=names, default=paper_frames, metavar="GLOB,GLOB")
    option("--torch-frames", "frames for torch", type=names, default=torch_frames, metavar="GLOB,GLOB")
    option("--torch-timeout", "longest PyTorch run", type=common.positive, default=3600, metavar="SECONDS")
    shot_presets = "presets for shots as wholes, one model for all frames, or none (default: balanced)"
    option("--shots", shot_presets, type=names, default=("balanced",), metavar="A,B")
    option("--no-large", "leave out the frame of 1280 x 720", dest="large", action="store_false")
    option("--crops", "measure the quarters of the frames instead, each as its own picture", action="store_true")
    option(
        "--ablations",
        "instead of methods and presets: this preset with one setting changed at a time, on every frame as denoised "
        "(the first of a shot), in a record of its own",
        choices=PRESETS,
        metavar="PRESET",
    )
    option(
        "--method",
        "also run sspc-train fit with these arguments, e.g. 'no albedo=--role albedo=none', with every preset; "
        "repeatable",
        type=named,
        action="append",
        default=[],
        metavar="NAME=ARGUMENTS",
    )
    option("--seeds", "seeds (default 1)", type=common.numbers, default=[1], metavar="1,2")
    option(
        "--repeat", "runs of each kind; the median of the seconds counts", type=common.positive, default=1, metavar="N"
    )
    option("--pin", "cores to run on (Linux)", type=common.numbers, metavar="0,1")
    option(
        "--render-seconds",
        "render time of a frame, for equal-time figures; repeatable (a folder's own: bench/frames.py)",
        type=seconds_of,
        action="append",
        default=[],
        metavar="FRAME=SECONDS",
    )
    option(
        "--steps", "a trial: N steps per fit (PyTorch: one epoch), goals not judged", type=common.positive, metavar="N"
    )
    option("--timeout", "longest run (default 3600)", type=common.positive, default=3600, metavar="SECONDS")
    option("--keep", "keep the pictures and reports of every run here", type=Path, metavar="DIR")
    return parser


def names(value):
    return () if value == "none" else tuple(name for name in value.split(",") if name)


def method_names(value):
    unknown = set(names(value)) - set(jobs.NAMES)
    if unknown:
        raise argparse.ArgumentTypeError(f"no method {', '.join(sorted(unknown))}; known: {', '.join(jobs.NAMES)}")
    return names(value)


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
    train, infer = (common.program(options, name) for name in ("sspc-train", "sspc-infer"))
    python = None
    if "torch" in options.methods and not options.ablations:
        python = os.environ.get("SSPC_PYTHON_VENV")
        if not python:
            made = subprocess.run([REPOSITORY / ".ci" / "setup-python"], stdout=subprocess.PIPE, text=True)
            if made.returncode:
                fail("the method torch needs the virtual environment of reference-py, which could not be made")
            python = made.stdout.strip()
    edit = train.parent / "examples" / "edit_exr"
    return runs.Programs(train, infer, edit, python and Path(python), REPOSITORY / "reference-py")


def carry_out(todo, programs, options, scratch):
    """Runs the jobs until Ctrl-C or SIGTERM; returns the results so far and how it ended."""
    environment = common.environment(options)
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
    ratio = (
        f"{known['corrected'] / known['denoised']:.3f} of the denoiser's, "
        if known and known["denoised"]
        else "no reference, "
    )
    threads = f", {result['threads']} threads" if result.get("threads") else ""
    return f"{start}{ratio}{result['wall_seconds']:.2f} s, {result['peak_rss_bytes'] / 2**20:.0f} MiB{threads}"


def duration(seconds):
    if seconds is None or seconds < 90:
        return f"{seconds or 0:.0f} s"
    return f"{seconds / 60:.0f} min"


def cleaned(results, options):
    """Results without the folders of this machine: records are shared."""
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
    """Prints verdicts and problems; returns the exit code."""
    for preset in record.rated():
        for verdict in record.verdicts(preset):
            say(f"{preset}: {verdict.what} {verdict.goal}: {verdict.found}, {verdict.word.strip('*')}")
    if any(not result["failure"] for result in record.shots):
        for words in shots.plain(record.shots):
            say(words)
    every = [*record.results, *record.shots]
    failed = [result for result in every if result["failure"]]
    for problem in record.about["problems"]:
        say(f"WARNING: {problem}", loud=True)
    if failed:
        say(f"{len(failed)} of {len(every)} runs FAILED; the record names them", loud=True)
    if ended == "interrupted":
        return 130
    return 1 if failed else 0


def say(text, loud=False):
    print(text, file=sys.stderr if loud else sys.stdout, flush=True)
