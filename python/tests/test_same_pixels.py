"""Pictures and models are those of the programs, bit for bit."""

import json
import re

import numpy as np
import onnx
import pytest
from conftest import make_differences, make_frame, read_exr, run, same_bits, write_exr, write_frame
from onnx import numpy_helper

import sspc

CASES = {
    "balanced": {"steps": 12},
    "fast": {"preset": "fast", "seed": 7},
    "quality": {"preset": "quality", "steps": 9},
    "paper": {"preset": "paper", "steps": 2},
    "settings": {"steps": 5, "settings": {"window": 15, "layers": 2, "skip": "none"}},
}


def options(case):
    """The options of `sspc-train fit` that say the same as the arguments of `sspc.fit`."""
    settings = [f"--set={key}={value}" for key, value in case.get("settings", {}).items()]
    return [f"--{key}={case[key]}" for key in ("preset", "seed", "steps") if key in case] + settings


def fitted(folder, arguments, *more):
    """Picture, model file and report of the program."""
    done = run("sspc-train", "fit", *arguments, *more, "-q", "-o", folder / "out")
    assert done.returncode == 0, done.stderr
    out = folder / "out"
    return read_exr(out / "corrected.exr"), out / "model.onnx", json.loads((out / "report.json").read_text())


def corrected(folder, arguments, model, *more):
    """Picture and sidecar of `sspc-infer run`."""
    done = run("sspc-infer", "run", "--model", model, *arguments, *more, "--json", "-q", "-o", folder / "run.exr")
    assert done.returncode == 0, done.stderr
    return read_exr(folder / "run.exr"), json.loads((folder / "run.json").read_text())


def weights(path):
    tensors = onnx.load(path).graph.initializer
    return {tensor.name: numpy_helper.to_array(tensor) for tensor in tensors}


def same_weights(left, right):
    left, right = weights(left), weights(right)
    return left.keys() == right.keys() and all(same_bits(left[name], right[name]) for name in left)


@pytest.mark.parametrize("name", CASES)
def test_fit_and_correct_are_the_programs(name, tmp_path, frame):
    case = CASES[name]
    arguments = write_frame(tmp_path, frame)
    picture, file, report = fitted(tmp_path, arguments, *options(case))

    model = sspc.fit(**frame, **case)
    model.save(tmp_path / "own.onnx")
    result = model.correct(**frame)

    assert same_weights(tmp_path / "own.onnx", file)
    assert same_bits(result.picture, picture)
    # Something was corrected, or the test says little.
    assert result.fallback is None and not same_bits(result.picture, frame["denoised"])
    by_run, sidecar = corrected(tmp_path, arguments, tmp_path / "own.onnx")
    assert same_bits(result.picture, by_run)
    assert [step["loss"] for step in model.report["history"]] == [step["loss"] for step in report["history"]]
    assert model.report["settings"] == report["settings"]
    for key in ("estimate", "loss", "model_loss", "mean_share", "active_share", "exposure", "found", "independence"):
        assert result.report[key] == sidecar[key], key
    assert result.report["warnings"] == sidecar["warnings"]


def test_differences_are_used_as_the_programs_use_them(tmp_path):
    case = {"steps": 12, "settings": {"differences": 1}}
    # So noisy that not all of the correction is kept.
    plain = make_frame(noise=1.0)
    frame = plain | make_differences()
    arguments = write_frame(tmp_path, frame)
    picture, file, _ = fitted(tmp_path, arguments, *options(case))
    model = sspc.fit(**frame, **case)
    result = model.correct(**frame)
    assert result.fallback is None and same_bits(result.picture, picture)
    by_run, sidecar = corrected(tmp_path, arguments, file)
    assert same_bits(by_run, picture) and result.report["warnings"] == sidecar["warnings"]
    # A frame without them is judged by its colours, and one with some of them too; both are said.
    partial = {name: array for name, array in frame.items() if name not in ("dx_a", "dy_a")}
    with pytest.warns(sspc.FrameWarning, match="this frame has no dx and dy"):
        without = model.correct(**plain)
    assert not same_bits(without.picture, picture)
    with pytest.warns(sspc.FrameWarning, match="expected dx_a, dx_b, dy_a and dy_b"):
        assert same_bits(model.correct(**partial).picture, without.picture)
    # Unless they are asked for, they change nothing.
    with pytest.warns(sspc.FrameWarning, match="given and not used"):
        unasked = sspc.fit(**frame, steps=12)
    assert same_bits(unasked.correct(**frame).picture, sspc.fit(**plain, steps=12).correct(**frame).picture)


def test_the_sample_with_default_settings(tmp_path, sample):
    half, _ = sample
    picture, _, report = fitted(tmp_path, write_frame(tmp_path, half))
    result = sspc.fit(**half).correct(**half)
    assert result.fallback is None and result.report["mean_share"] == report["mean_share"] > 0.1
    # The program writes its picture in the type of the input.
    assert same_bits(result.picture.astype(np.float16), picture)


@pytest.mark.parametrize("strength", [0.0, 0.5])
def test_strength(strength, tmp_path, frame, model):
    model.save(tmp_path / "model.onnx")
    arguments = write_frame(tmp_path, frame)
    picture, _ = corrected(tmp_path, arguments, tmp_path / "model.onnx", "--strength", strength)
    result = model.correct(**frame, strength=strength)
    assert same_bits(result.picture, picture)
    assert same_bits(picture, frame["denoised"]) == (strength == 0.0)


def test_training_goes_on_from_a_model(tmp_path, frame, model):
    model.save(tmp_path / "start.onnx")
    arguments = write_frame(tmp_path, frame)
    _, file, _ = fitted(tmp_path, arguments, "--init", tmp_path / "start.onnx", "--steps", "3")
    sspc.fit(**frame, init=model, steps=3).save(tmp_path / "own.onnx")
    assert same_weights(tmp_path / "own.onnx", file)


def one_pixel(frame):
    return {name: array[:1, :1] for name, array in frame.items()}


def with_missing_pixels(frame):
    frame["a"][3, 4, 1] = np.nan
    frame["denoised"][10:12, 20] = np.inf
    frame["albedo_b"][7, 7] = np.nan
    return frame


def without_features(frame):
    return {name: frame[name] for name in ("a", "b", "denoised_a", "denoised_b")}


def in_half_floats(frame):
    return {name: array.astype(np.float16) for name, array in frame.items()}


@pytest.mark.parametrize("change", [one_pixel, with_missing_pixels, without_features, in_half_floats])
def test_unusual_frames(change, tmp_path):
    frame = change(make_frame())
    picture, _, _ = fitted(tmp_path, write_frame(tmp_path, frame), "--steps=4")
    result = sspc.fit(**frame, steps=4).correct(**frame)
    assert same_bits(result.picture.astype(picture.dtype), picture)
    assert np.isfinite(result.picture).all()


def test_another_frame_of_the_shot(tmp_path, model):
    other = make_frame(seed=5)
    model.save(tmp_path / "model.onnx")
    picture, _ = corrected(tmp_path, write_frame(tmp_path, other), tmp_path / "model.onnx")
    assert same_bits(model.correct(**other).picture, picture)


def test_models_of_the_program_are_loaded(tmp_path, frame):
    picture, file, _ = fitted(tmp_path, write_frame(tmp_path, frame), "--steps=6")
    assert same_bits(sspc.Model.load(file).correct(**frame).picture, picture)


def further(frame):
    """Two further denoised pictures of each half: one blurred with a full buffer, one sharper without."""
    halves = [frame[f"denoised_{half}"] for half in "ab"]
    blurred = [(half + np.roll(half, 1, 0)) / 2 for half in halves]
    sharper = [1.5 * half - 0.5 * np.roll(half, 1, 1) for half in halves]
    return [(*blurred, (blurred[0] + blurred[1]) / 2), tuple(sharper)]


def test_several_denoised_pictures(tmp_path, frame):
    more = further(frame)
    options = ["--steps=6"]
    for at, pictures in enumerate(more):
        paths = [tmp_path / f"more{at}{which}.exr" for which, _ in enumerate(pictures)]
        for path, picture in zip(paths, pictures):
            write_exr(path, dict(zip("RGB", np.moveaxis(picture, -1, 0))))
        options.append("--denoised-more=" + ",".join(map(str, paths)))
    arguments = write_frame(tmp_path, frame)
    picture, file, _ = fitted(tmp_path, arguments, *options)

    model = sspc.fit(**frame, denoised_more=more, steps=6)
    model.save(tmp_path / "own.onnx")
    result = model.correct(**frame, denoised_more=more)
    assert same_weights(tmp_path / "own.onnx", file)
    assert same_bits(result.picture, picture)
    by_run, _ = corrected(tmp_path, arguments, file, *options[1:])
    assert same_bits(result.picture, by_run)
    assert not same_bits(result.picture, sspc.fit(**frame, steps=6).correct(**frame).picture)

    with pytest.raises(sspc.Error, match="the model wants 3 denoised pictures of each half, found 2") as refused:
        model.correct(**frame, denoised_more=more[:1])
    assert refused.value.code == 3


def test_halves_of_unequal_samples(tmp_path, frame):
    options = ["--samples-a", "32", "--samples-b", "8"]
    arguments = write_frame(tmp_path, frame)
    picture, file, _ = fitted(tmp_path, arguments, *options, "--steps=6")
    model = sspc.fit(**frame, samples=(32, 8), steps=6)
    result = model.correct(**frame, samples=(32, 8))
    assert same_bits(result.picture, picture)
    assert not same_bits(result.picture, model.correct(**frame).picture)
    by_run, _ = corrected(tmp_path, arguments, file, *options)
    assert same_bits(result.picture, by_run)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ((0, 8), "samples: half a has 0 samples"),
        ((8, float("nan")), "samples: half b has NaN samples"),
        ((1, 1000), "samples: halves of 1 and 1000 samples"),
        ((8,), "samples: expected two numbers, found (8,)"),
        (8, "samples: expected two numbers, found 8"),
    ],
)
def test_samples_that_no_halves_have_are_refused(samples, message, frame):
    with pytest.raises(sspc.Error, match=re.escape(message)) as refused:
        sspc.fit(**frame, samples=samples, steps=1)
    assert refused.value.code == 2
