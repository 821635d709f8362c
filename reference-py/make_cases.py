"""Writes the parity cases, or checks that the committed ones are what this code makes.

    python make_cases.py [--root ../tests/cases]           write
    python make_cases.py [--root ../tests/cases] --check   compare, exit 1 on a difference

With --preset also the paper's preset on the sample frame, which takes minutes.
"""

import argparse
import sys
from pathlib import Path

import torch
from parity import gc_cases, preset_case, shot_cases, stage_cases, training_cases

DEFAULT_ROOT = Path(__file__).resolve().parent.parent / "tests" / "cases"


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=DEFAULT_ROOT)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--preset", action="store_true")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)

    cases = gc_cases.cases() + stage_cases.cases() + training_cases.cases() + shot_cases.cases()
    if options.preset:
        cases += preset_case.cases()
    if not options.check:
        for case in cases:
            case.write(options.root)
        print(f"{len(cases)} cases written to {options.root}")
        return 0

    lines = [line for case in cases for line in case.differences(options.root)]
    stored = {path.parent.name for path in options.root.glob("*/io.npz")}
    if not options.preset:
        stored -= {preset_case.NAME}
    lines += [f"{name}: no code makes it" for name in sorted(stored - {c.name for c in cases})]
    for line in lines:
        print(line)
    print(f"parity cases: {len(cases)} regenerated, {len(lines)} differences")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
