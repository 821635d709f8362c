"""Shared by the commands of this folder: options, the programs measured, and the head of a record."""

import argparse
import os
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path

from . import machine

REPOSITORY = Path(__file__).resolve().parents[1]
BUILD = "cargo build --release --workspace --bins --examples"
# Options whose values are folders of this machine and change no figure.
LOCAL_OPTIONS = ("--bin-dir", "--keep", "--scratch", "-o", "--output")


def parser(prog, description):
    """A command line with the options that every command takes."""
    made = argparse.ArgumentParser(
        prog=prog, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("--threads", type=positive, metavar="N", help="threads per run (default: one per usable core)")
    made.add_argument("--bin-dir", type=folder, metavar="DIR", help="folder of the programs (default: target/release)")
    return made


def add_output(made):
    """The option that names the folder of the records."""
    records = REPOSITORY / "bench" / "records"
    made.add_argument("-o", "--output", type=Path, default=records, metavar="DIR", help="default: bench/records")


def program(options, name):
    """Path of a built program or example; ends the command where it is not built."""
    target = Path(os.environ.get("CARGO_TARGET_DIR") or REPOSITORY / "target")
    path = (options.bin_dir or target / "release").resolve() / name
    if not path.is_file():
        fail(f"{path} does not exist; run `{BUILD}`, or give --bin-dir")
    return path


def environment(options):
    """Environment of the programs measured."""
    threads = {"RAYON_NUM_THREADS": str(options.threads)} if options.threads else {}
    return dict(os.environ) | threads


def about(prog, arguments, options, measured):
    """What a record states besides its figures: date, commit, programs, machine and command."""
    head = machine.commit(REPOSITORY)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": head,
        "programs": [machine.program(path, head) for path in measured],
        "machine": machine.machine(options.threads),
        "command": shown(prog, sys.argv[1:] if arguments is None else arguments),
    }


def heading(head):
    """One line of what `about` says, over a table that is printed."""
    commit, changed = head["commit"], ", changed" if head["commit"]["dirty"] else ""
    return f"Commit {commit['hash']}{changed}, {head['date']}, {head['machine']['processor']}"


def shown(prog, arguments):
    """The command without the options that name folders of this machine only."""
    words, skip = [], False
    for word in arguments:
        name, mark, _ = word.partition("=")
        local = name in LOCAL_OPTIONS
        if not local and not skip:
            words.append(word)
        skip = local and not mark
    return shlex.join([prog, *words])


def fail(text):
    print(f"bench: {text}", file=sys.stderr)
    raise SystemExit(2)


def folder(value):
    path = Path(value)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{value} is not a folder")
    return path


def existing(value):
    path = Path(value)
    if not path.exists():
        raise argparse.ArgumentTypeError(f"{value} does not exist")
    return path.resolve()


def positive(value):
    if int(value) < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a number above 0")
    return int(value)


def numbers(value):
    return [int(part) for part in value.split(",")]


def sizes(value):
    """'640x360,1280x720' as [(640, 360), (1280, 720)]: width and height in pixels."""
    found = [tuple(int(side) for side in part.split("x")) for part in value.split(",")]
    if any(len(size) != 2 or min(size) < 1 for size in found):
        raise argparse.ArgumentTypeError(f"{value} is not WxH,WxH")
    return found
