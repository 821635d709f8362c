"""What the tests share: frames in memory, the same frames as files, and the programs of the wheel."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

import sspc

SAMPLE = Path(__file__).resolve().parents[2] / "tests" / "data" / "sample"
LAYERS = {"denoised": "RGB", "albedo": "RGB", "normal": "XYZ", "visibility": "Y"}
DIFFERENCES = {"dx": "RGB", "dy": "RGB"}


def pytest_configure(config):
    # A run of many frames: what is absent from them is not news.
    config.addinivalue_line("filterwarnings", "ignore::sspc.FrameWarning")


def make_frame(height=40, width=56, seed=0, noise=0.3):
    """A textured picture with noise: every array of a frame by its argument's name, float32."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    albedo = 0.5 + 0.3 * np.stack([np.sin(x / 2), np.cos(y / 3), np.sin((x + y) / 4)], axis=-1)
    light = 0.4 + 0.3 * np.cos(x / 20)[..., None]
    truth = albedo * light
    blurred = (truth + np.roll(truth, 1, 0) + np.roll(truth, 1, 1) + np.roll(truth, (1, 1), (0, 1))) / 4
    frame = {}
    for half in "ab":
        frame[half] = truth * random.exponential(1.0, truth.shape) ** noise
        frame[f"denoised_{half}"] = np.maximum(blurred + 0.02 * random.standard_normal(truth.shape), 0)
        frame[f"albedo_{half}"] = albedo + 0.01 * random.standard_normal(truth.shape)
        frame[f"normal_{half}"] = np.stack([np.sin(x / 9), np.cos(x / 9), 0 * x], axis=-1)
        frame[f"visibility_{half}"] = (x + y > 30).astype(np.float32) + 0.1 * random.random((height, width))
    frame["denoised"] = (frame["denoised_a"] + frame["denoised_b"]) / 2
    return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in frame.items()}


def make_differences(height=40, width=56, noise=0.02):
    """dx and dy of both halves of `make_frame`, with a little noise of their own."""
    random = np.random.default_rng(5)
    y, x = np.mgrid[0 : height + 1, 0 : width + 1].astype(np.float32)
    albedo = 0.5 + 0.3 * np.stack([np.sin(x / 2), np.cos(y / 3), np.sin((x + y) / 4)], axis=-1)
    truth = albedo * (0.4 + 0.3 * np.cos(x / 20)[..., None])
    right, below = truth[:-1, 1:] - truth[:-1, :-1], truth[1:, :-1] - truth[:-1, :-1]
    given = {f"d{axis}_{half}": plane for half in "ab" for axis, plane in (("x", right), ("y", below))}
    return {name: np.float32(plane + noise * random.standard_normal(plane.shape)) for name, plane in given.items()}


def write_frame(folder, frame):
    """The frame as a.exr, b.exr and denoised.exr, of the arrays' own type; their arguments to the programs."""
    for half in "ab":
        channels = dict(zip("RGB", np.moveaxis(frame[half], -1, 0)))
        for role, components in (LAYERS | DIFFERENCES).items():
            if f"{role}_{half}" in frame:
                array = frame[f"{role}_{half}"]
                planes = np.moveaxis(array.reshape(*array.shape[:2], -1), -1, 0)
                channels |= {f"{role}.{component}": plane for component, plane in zip(components, planes)}
        write_exr(folder / f"{half}.exr", channels)
    arguments = [folder / "a.exr", folder / "b.exr"]
    if "denoised" in frame:
        write_exr(folder / "denoised.exr", dict(zip("RGB", np.moveaxis(frame["denoised"], -1, 0))))
        arguments += ["--denoised", folder / "denoised.exr"]
    return arguments


def write_exr(path, channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    OpenEXR.File(header, channels).write(str(path))


def read_exr(path, names=("R", "G", "B")):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in names], axis=-1)


def read_sample():
    """The frame of the repository and its reference, halves of it included, as float16."""
    frame = {"denoised": read_exr(SAMPLE / "denoised.exr")}
    for half in "ab":
        frame[half] = read_exr(SAMPLE / f"{half}.exr")
        for role, components in LAYERS.items():
            names = [f"{role}.{component}" for component in components]
            frame[f"{role}_{half}"] = read_exr(SAMPLE / f"{half}.exr", names)
    names = {"reference": "{}", "reference_a": "a.{}", "reference_b": "b.{}"}
    reference = {key: read_exr(SAMPLE / "ref.exr", [name.format(c) for c in "RGB"]) for key, name in names.items()}
    return frame, reference


def run(program, *arguments):
    """One of the wheel's programs, from beside the interpreter."""
    path = Path(sys.executable).with_name(program)
    assert path.exists(), f"{program} is not installed with the package"
    return subprocess.run([path, *map(str, arguments)], capture_output=True, text=True, check=False)


def same_bits(left, right):
    return left.shape == right.shape and left.dtype == right.dtype and left.tobytes() == right.tobytes()


@pytest.fixture
def frame():
    return make_frame()


@pytest.fixture(scope="session")
def sample():
    return read_sample()


@pytest.fixture(scope="session")
def model():
    return sspc.fit(**make_frame(), steps=5)
