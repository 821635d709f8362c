"""Arguments, reports, failures and models."""

import pickle

import numpy as np
import pytest
from conftest import make_frame, run, same_bits, write_exr, write_frame

import sspc


def test_progress_is_told_of_every_step(frame):
    steps = []
    model = sspc.fit(**frame, steps=4, progress=steps.append)
    assert [(step.step, step.of) for step in steps] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert all(step.loss > 0 and step.rate > 0 and step.seconds > 0 for step in steps)
    assert repr(steps[0]).startswith("Step(step=1, of=4, loss=")
    assert [step["loss"] for step in model.report["history"]] == [step.loss for step in steps]


def test_a_model_says_what_it_is(frame):
    model = sspc.fit(**frame, preset="fast", seed=3, steps=2)
    assert (model.preset, model.seed, model.steps) == ("fast", 3, 2)
    assert model.features == ("albedo", "normal", "visibility")
    assert "fast" in repr(model) and "2 steps" in repr(model)
    assert model.report["end"] == "all-steps" and model.report["settings"]["window_radius"] == 6


def test_the_seed_decides(frame):
    one, again, other = (sspc.fit(**frame, seed=seed, steps=3).correct(**frame).picture for seed in (1, 1, 2))
    assert same_bits(one, again) and not same_bits(one, other)


def test_a_time_limit_ends_training(frame):
    model = sspc.fit(**frame, steps=10**6, time_limit=0.2)
    assert model.report["end"] == "time-limit" and 0 < model.steps < 10**6


def test_no_steps_give_the_starting_network(frame):
    model = sspc.fit(**frame, steps=0)
    assert model.steps == 0 and model.correct(**frame).picture.shape == (40, 56, 3)


def test_the_estimate_and_the_report_agree(frame, model):
    result = model.correct(**frame)
    assert result.estimate.corrected.value == result.report["estimate"]["corrected"]["value"]
    assert result.estimate.gain.standard_error > 0
    assert result.report["width"] == 56 and result.report["strength"] == 1.0


def test_the_fallback_is_the_denoiser_s_picture(model):
    frame = make_frame()
    frame["a"] = 2 * frame["a"]
    with pytest.warns(sspc.FrameWarning, match="the frame is unlike those that the model was fitted on"):
        result = model.correct(**frame)
    assert result.fallback and result.fallback == result.report["fallback"] and result.report["mean_share"] == 0
    assert same_bits(result.picture, frame["denoised"]) and not result.share.any()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"preset": "slow"}, "preset 'slow': expected paper, fast, balanced, quality"),
        ({"settings": {"window": 4}}, "--set window=4: expected side of the window of g_c in pixels, odd, 3 to 25"),
        ({"settings": {"colour": 1}}, "--set colour: no such setting; there are window, early-window"),
        ({"time_limit": 0.0}, "time_limit 0: expected a positive number of seconds"),
        ({"time_limit": float("nan")}, "time_limit NaN: expected"),
    ],
)
def test_arguments_without_meaning(arguments, text, frame):
    with pytest.raises(sspc.Error) as caught:
        sspc.fit(**frame, **arguments)
    assert caught.value.message.startswith(text) and caught.value.code == 2


@pytest.mark.parametrize("strength", [-0.1, 1.1, float("nan")])
def test_a_strength_beyond_its_range(strength, frame, model):
    with pytest.raises(sspc.Error, match=r"expected a number from 0 to 1") as caught:
        model.correct(**frame, strength=strength)
    assert caught.value.code == 2


def test_arguments_of_another_type_are_type_errors(frame):
    for wrong in ({"seed": "one"}, {"steps": 1.5}, {"preset": 3}, {"unknown": 1}):
        with pytest.raises(TypeError):
            sspc.fit(**frame, **wrong)
    with pytest.raises(OverflowError):
        sspc.fit(**frame, seed=-1)
    del frame["denoised_a"]
    with pytest.raises(TypeError, match="denoised_a"):
        sspc.fit(**frame)


def said_by_the_program(folder, frame):
    done = run("sspc-train", "fit", *write_frame(folder, frame), "--steps", "1", "-o", folder / "out")
    error, advice = (line.partition(": ")[2] for line in done.stderr.splitlines()[-2:])
    for half in "ab":
        error = error.replace(str(folder / f"{half}.exr"), half)
    return error, advice, done.returncode


def test_failures_have_the_programs_words_and_codes(tmp_path):
    identical = make_frame()
    identical["b"] = identical["a"]
    nothing = make_frame()
    nothing["b"][..., 1] = np.nan
    for frame in (identical, nothing):
        with pytest.raises(sspc.Error) as caught:
            sspc.fit(**frame, steps=1)
        own = (caught.value.message, caught.value.advice, caught.value.code)
        assert own == said_by_the_program(tmp_path, frame)


def test_files_that_are_no_models(tmp_path):
    write_exr(tmp_path / "picture.exr", {"R": np.zeros((2, 2), np.float32)})
    for path in (tmp_path / "absent.onnx", tmp_path / "picture.exr", tmp_path):
        with pytest.raises(sspc.Error) as caught:
            sspc.Model.load(path)
        done = run("sspc-infer", "info", path)
        assert done.stderr.splitlines()[0] == f"error: {caught.value.message}"
        assert caught.value.code == done.returncode == 3
    with pytest.raises(sspc.Error, match="cannot write|no folder"):
        sspc.fit(**make_frame(), steps=0).save(tmp_path / "no" / "model.onnx")


def test_saved_pickled_and_loaded_models_are_the_same(tmp_path, frame, model):
    expected = model.correct(**frame).picture
    for graph in ("network", "image"):
        model.save(tmp_path / f"{graph}.onnx", graph)
        loaded = sspc.Model.load(tmp_path / f"{graph}.onnx")
        assert same_bits(loaded.correct(**frame).picture, expected)
        assert loaded.report is None and loaded.steps == model.steps
    assert (tmp_path / "image.onnx").stat().st_size > (tmp_path / "network.onnx").stat().st_size
    copied = pickle.loads(pickle.dumps(model))
    assert same_bits(copied.correct(**frame).picture, expected) and copied.report == model.report
    with pytest.raises(sspc.Error, match="graph 'picture': expected network, image"):
        model.save(tmp_path / "x.onnx", "picture")


def test_errors_can_be_pickled():
    error = pickle.loads(pickle.dumps(sspc.Error("what", "why", 3)))
    assert (error.message, error.advice, error.code, str(error)) == ("what", "why", 3, "what\nadvice: why")


def test_the_programs_are_of_the_package_s_version():
    from importlib.metadata import version

    for program in ("sspc-train", "sspc-infer"):
        done = run(program, "--version")
        assert done.stdout.split() == [program, version("sspc")]
