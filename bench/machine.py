"""What a record states about the machine, the commit and the programs measured."""

import hashlib
import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path


def machine(threads):
    """Processor, usable cores, threads requested, memory, system, load before the first run."""
    return {
        "processor": first_value("/proc/cpuinfo", "model name") or platform.processor() or platform.machine(),
        "cores_usable": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "cores_present": os.cpu_count(),
        "threads_asked": threads,
        "memory_bytes": memory_bytes(),
        "system": system(),
        "load_average_before": load(),
    }


def load():
    return [round(value, 2) for value in os.getloadavg()]


def first_value(path, key):
    """Value of the first 'key : value' or 'key=value' line of a file, None when there is none."""
    try:
        lines = Path(path).read_text().splitlines()
    except OSError:
        return None
    for line in lines:
        name, mark, value = line.partition(":") if ":" in line else line.partition("=")
        if mark and name.strip() == key:
            return value.strip().strip('"')
    return None


def memory_bytes():
    text = first_value("/proc/meminfo", "MemTotal")
    return int(text.split()[0]) * 1024 if text else None


def system():
    release = first_value("/etc/os-release", "PRETTY_NAME")
    kernel = f"{platform.system()} {platform.release()}"
    return f"{release}, {kernel}" if release else kernel


def commit(repository):
    """Short hash, time of the commit, and whether the working tree differs from it."""

    def git(*arguments):
        done = subprocess.run(["git", *arguments], cwd=repository, capture_output=True, text=True)
        return done.stdout.strip() if done.returncode == 0 else None

    changed = git("status", "--porcelain", "--untracked-files=no")
    when = git("log", "-1", "--format=%ct")
    return {
        "hash": git("rev-parse", "--short", "HEAD") or "no-commit",
        "time": int(when) if when else None,
        "dirty": bool(changed),
    }


def program(path, head):
    """Fingerprint of a program, and whether it was built before the commit."""
    status = path.stat()
    return {
        "name": path.name,
        "sha256": fingerprint(path),
        "built": datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds"),
        "older_than_commit": head["time"] is not None and status.st_mtime < head["time"],
    }


def fingerprint(path):
    """Reads in pieces: a child's peak memory starts at what this process holds when it forks."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def unchanged(path, program):
    return path.exists() and fingerprint(path) == program["sha256"]
