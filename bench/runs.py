"""Runs one job as a whole process, file to file, and checks its answer."""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from .jobs import TORCH

# corrected.exr holds half floats, which round by at most 2^-11, and rounding errors nearly cancel in relL2: a larger
# difference between report.json and the file means a wrong answer.
FILE_TOLERANCE = 1e-3

# PyTorch's tensors are small here: a second thread costs more processor seconds than it saves.
TORCH_THREADS = 1


class Failed(Exception):
    """A run failed, or its answer is not what it reports."""


@dataclass(frozen=True)
class Programs:
    train: Path
    infer: Path
    # The example that derives frames.
    edit: Path
    # Interpreter with PyTorch.
    python: Path | None
    reference_py: Path


@dataclass(frozen=True)
class Process:
    wall_seconds: float
    cpu_seconds: float
    peak_rss_bytes: int
    exit_code: int
    stdout: str
    stderr: str


def run_process(command, environment, limit, cwd=None):
    """Runs a command for at most `limit` seconds; returns time, memory and exit code of that process alone."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        begin = time.perf_counter()
        process = subprocess.Popen(command, stdout=out, stderr=err, env=environment, cwd=cwd)
        guard = threading.Timer(limit, process.kill)
        guard.start()
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except KeyboardInterrupt:
            # A terminal sends Ctrl-C to the child as well, but a signal to this process alone does not reach it.
            process.terminate()
            process.wait()
            raise
        finally:
            guard.cancel()
        wall = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode(errors="replace"))
    kilobyte = 1 if sys.platform == "darwin" else 1024
    cpu = usage.ru_utime + usage.ru_stime
    return Process(wall, cpu, usage.ru_maxrss * kilobyte, process.returncode, *texts)


def run_job(job, programs, folder, environment, limit):
    """Runs a job with its output in `folder`; returns its entry in the record, with the reason if it failed."""
    result = {
        "frame": job.frame.name,
        "method": job.method.name,
        "preset": job.preset,
        "column": job.column,
        "seed": job.seed,
        "repeat": job.repeat,
        "failure": None,
    }
    try:
        run = torch if job.method.name == TORCH else fit
        result |= run(job, programs, folder, environment, limit)
        if job.frame.reference:
            result |= check(job, programs, folder, environment, limit, result)
    except Failed as failure:
        result["failure"] = str(failure)
    return result


def checked_process(name, *arguments, **named):
    process = run_process(*arguments, **named)
    if process.exit_code != 0:
        last = process.stderr.strip().splitlines()[-3:]
        raise Failed(f"{name} ended with exit code {process.exit_code}: {' / '.join(last) or 'no message'}")
    return process


def measured(process):
    return {
        "wall_seconds": process.wall_seconds,
        "cpu_seconds": process.cpu_seconds,
        "peak_rss_bytes": process.peak_rss_bytes,
    }


def fit(job, programs, folder, environment, limit):
    command = [str(programs.train), "fit", *job.frame.arguments(), "--preset", job.preset]
    command += ["--seed", str(job.seed), *job.method.arguments, "--quiet", "-o", str(folder)]
    process = checked_process("sspc-train", command, environment, limit)
    try:
        report = json.loads((folder / "report.json").read_text())
        result = measured(process) | of_report(report)
    except (OSError, ValueError, KeyError) as error:
        raise Failed(f"report.json: {type(error).__name__}: {error}") from error
    if job.frame.reference and result["rel_l2"] is None:
        raise Failed("report.json has no rel_l2 although a reference was given")
    return result


def of_report(report):
    """What a record keeps of report.json: all but the paths, and the loss at every tenth of the steps only."""
    kept = {key: value for key, value in report.items() if key not in ("roles", "history", "rel_l2")}
    if kept.get("denoiser"):
        kept["denoiser"] = kept["denoiser"] | {"library": Path(kept["denoiser"]["library"]).name}
    history = report.get("history", [])
    every = max(len(history) // 10, 1)
    kept["loss_every_tenth"] = [[step["step"], step["loss"]] for step in history[every - 1 :: every]]
    return {
        "width": report["width"],
        "height": report["height"],
        "threads": report.get("threads"),
        "steps": report.get("steps"),
        "fallback": report.get("fallback"),
        "seconds": report.get("seconds"),
        "rel_l2": report.get("rel_l2"),
        "report": kept,
    }


def torch(job, programs, folder, environment, limit):
    """The reference implementation with the paper's schedule; it prints relL2 as JSON lines.

    It is not given the denoised full buffer, which it would correct as well, outside the comparison; `check` measures
    relL2 of that picture.
    """
    folder.mkdir(parents=True, exist_ok=True)
    frame = job.frame
    command = [str(programs.python), "-m", "sspc_reference", "--threads", str(TORCH_THREADS), "fit"]
    command += [str(frame.a.resolve()), str(frame.b.resolve()), "--preset", "paper", "--seed", str(job.seed)]
    command += ["--reference", str(frame.reference.resolve()), "--weights", str(folder / "weights.npy")]
    command += ["-o", str(folder / "corrected.exr"), *job.method.arguments]
    process = checked_process("sspc_reference", command, environment, limit, cwd=programs.reference_py)
    lines = [json.loads(line) for line in process.stdout.splitlines() if line.startswith("{")]
    values = {line["image"]: line["relL2"] for line in lines}
    try:
        denoised = None if frame.denoised else values["denoised halves"]
        figures = {"noisy": values["noisy"], "denoised": denoised, "corrected": values["corrected"]}
    except KeyError as missing:
        raise Failed(f"sspc_reference printed no relL2 of {missing}") from missing
    return measured(process) | {"threads": TORCH_THREADS, "fallback": None, "rel_l2": figures}


def check(job, programs, folder, environment, limit, result):
    """Measures corrected.exr with sspc-infer; raises Failed where the figures differ from the run's.

    Fills in a relL2 that the run left out (None).
    """
    command = [str(programs.infer), "evaluate", str(folder / "corrected.exr"), "--json"]
    command += ["--reference", str(job.frame.reference)]
    if job.frame.denoised:
        command += ["--denoised", str(job.frame.denoised)]
    text = checked_process("sspc-infer evaluate", command, environment, limit).stdout
    try:
        evaluation = json.loads(text)
        found = {"corrected": evaluation["figures"]["rel_l2"]}
        if evaluation.get("denoised"):
            found["denoised"] = evaluation["denoised"]["figures"]["rel_l2"]
    except (ValueError, KeyError, TypeError) as error:
        raise Failed(f"sspc-infer evaluate: unreadable answer: {error}") from error
    for picture, value in found.items():
        said = result["rel_l2"][picture]
        if said is None:
            result["rel_l2"][picture] = value
        elif not agrees(said, value):
            raise Failed(f"relL2 of the {picture} picture: the run says {said:.8g}, the file written has {value:.8g}")
    if result["fallback"] and not agrees(result["rel_l2"]["corrected"], result["rel_l2"]["denoised"]):
        raise Failed("the run says that the output is the denoiser's, but its relL2 is not the denoiser's")
    size = {"width": evaluation["width"], "height": evaluation["height"]}
    beside = evaluation.get("denoised") or {}
    evaluated = {"evaluated": evaluation["figures"], "evaluated_denoised": beside.get("figures")}
    return size | evaluated | {"crossed_ratio": beside.get("crossed_ratio")}


def agrees(said, found):
    return abs(said - found) <= FILE_TOLERANCE * abs(found)


def repeats_agree(result, earlier):
    """None if an earlier fit with the same seed gave the same picture, else a description of the difference."""
    key = ("frame", "column", "seed")
    for other in earlier:
        same = all(other[k] == result[k] for k in key) and not other["failure"]
        if same and other.get("rel_l2") and result.get("rel_l2"):
            first, now = other["rel_l2"]["corrected"], result["rel_l2"]["corrected"]
            return None if first == now else f"relL2 {now:.8g}; the same seed gave {first:.8g} before"
    return None
