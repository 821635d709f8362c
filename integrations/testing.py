"""What the tests of the integrations share: the built programs, a small shot cut from the sample, skips said aloud."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "tests" / "data" / "sample"
BUILT = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"), "release").resolve()
# Width and height of the shot's frames in pixels.
SIZE = (96, 64)


def built(name):
    """Path of a program or example of this repository; an error where it was not built."""
    path = BUILT / name
    if not path.is_file():
        raise FileNotFoundError(f"{path}: run `cargo build --release --workspace --bins --examples`")
    return path


def environment(**more):
    """The environment with the built programs found first, and more variables."""
    return os.environ | {"PATH": f"{BUILT}{os.pathsep}{os.environ['PATH']}"} | more


def skip(test, why):
    """Leaves a test out, aloud: unittest keeps the reason to itself."""
    print(f"\nSKIPPED {test.id()}: {why}", file=sys.stderr)
    test.skipTest(why)


def write_shot(folder, frames):
    """Writes a.####.exr, b.####.exr and denoised.####.exr: the window moves over the sample by 8 pixels a frame."""
    for at, frame in enumerate(frames):
        for name in ("a", "b", "denoised"):
            target = folder / f"{name}.{frame:04}.exr"
            window = [str(number) for number in (8 * at, 4 * at, *SIZE)]
            subprocess.run([built("examples/edit_exr"), "crop", SAMPLE / f"{name}.exr", target, *window], check=True)
