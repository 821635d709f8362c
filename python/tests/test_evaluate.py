"""The figures of `sspc-infer evaluate`."""

import json
import math

import numpy as np
import pytest
from conftest import SAMPLE, run

import sspc


def program(*arguments):
    done = run("sspc-infer", "evaluate", *arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_programs_figures(sample):
    frame, reference = sample
    own = sspc.evaluate(frame["a"], **reference, denoised=frame["denoised"])
    files = [SAMPLE / "a.exr", "--reference", SAMPLE / "ref.exr", "--denoised", SAMPLE / "denoised.exr"]
    theirs = program(*files)
    assert own.figures._asdict() == theirs["figures"]
    assert own.denoised.figures._asdict() == theirs["denoised"]["figures"]
    for key in ("rel_l2_ratio", "crossed_ratio", "crossed_ratio_standard_error"):
        assert getattr(own.denoised, key) == theirs["denoised"][key]
    assert np.float32(own.exposure) == np.float32(theirs["exposure"])
    at_two = sspc.evaluate(frame["a"], **reference, exposure=2.0)
    assert at_two.figures._asdict() == program(*files[:3], "--exposure", "2")["figures"] and at_two.denoised is None


def test_equal_pictures_without_halves(frame):
    own = sspc.evaluate(frame["a"], frame["a"], denoised=frame["b"])
    assert own.figures.rel_l2 == 0 and own.figures.psnr == math.inf and own.figures.excluded == 0
    assert math.isnan(own.denoised.crossed_ratio) and own.denoised.rel_l2_ratio == 0


def test_missing_pixels_are_left_out(frame):
    broken = frame["a"].copy()
    broken[2, 3, 1] = np.nan
    assert sspc.evaluate(broken, frame["b"]).figures.excluded == 1
    with pytest.raises(
        sspc.Error, match="expected pixels that are finite in it and in reference, found none"
    ) as caught:
        sspc.evaluate(np.full_like(broken, np.nan), frame["b"])
    assert caught.value.code == 3


def test_bad_arguments(frame):
    with pytest.raises(sspc.Error, match="reference_a, reference_b: expected both or neither"):
        sspc.evaluate(frame["a"], frame["b"], reference_a=frame["b"])
    with pytest.raises(sspc.Error, match="reference: expected 56 x 40 pixels as in picture, found 55 x 40"):
        sspc.evaluate(frame["a"], frame["b"][:, 1:])
    for exposure in (0.0, -1.0, math.inf):
        with pytest.raises(sspc.Error, match="expected a number above 0") as caught:
            sspc.evaluate(frame["a"], frame["b"], exposure=exposure)
        assert caught.value.code == 2
