"""The example renders, denoises and corrects, where Mitsuba and OIDN are installed."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import read_exr

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "mitsuba_oidn.py"
MISSING = [name for name in ("mitsuba", "pyoidn") if find_spec(name) is None]


@pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}; the example is not run")
def test_the_example_corrects_a_render(tmp_path):
    done = subprocess.run([sys.executable, EXAMPLE], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    _, figures = done.stdout.strip().splitlines()[-1].split(": ")
    denoised, corrected = (float(figure.split()[0]) for figure in figures.split(", "))
    assert corrected < denoised, done.stdout
    assert read_exr(tmp_path / "corrected.exr").shape == (256, 256, 3)


def test_the_example_is_short():
    lines = [line for line in EXAMPLE.read_text().splitlines() if line.strip() and not line.startswith(("#", '"""'))]
    assert len(lines) <= 25
