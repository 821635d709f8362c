"""The check of the committed parity cases detects what it should."""

import numpy as np
import pytest
from parity.case import Case, Inputs, difference


@pytest.fixture
def case(tmp_path):
    case = Case("sample", "A sample.", {"radius": 9})
    case.put(inputs=Inputs(1).uniform(3, 4), results=np.linspace(0, 1, 5), tiles=np.arange(4))
    case.write(tmp_path)
    return case


def test_a_written_case_is_the_same(case, tmp_path):
    assert case.differences(tmp_path) == []


def test_last_digits_may_differ_and_no_more(case, tmp_path):
    case.arrays["results"] = case.arrays["results"] * (1 + 1e-12)
    assert case.differences(tmp_path) == []
    case.arrays["results"] = case.arrays["results"] * (1 + 1e-7)
    assert len(case.differences(tmp_path)) == 1
    case.arrays["tiles"] = case.arrays["tiles"] + 1
    assert len(case.differences(tmp_path)) == 2


def test_other_facts_names_shapes_and_types_are_differences(case, tmp_path):
    case.facts["radius"] = 3
    assert case.differences(tmp_path) == ["sample: case.json differs"]
    case.facts["radius"] = 9
    case.arrays["more"] = np.zeros(1)
    assert "['more']" in case.differences(tmp_path)[0]
    assert "found float64[4]" in difference(np.zeros(3), np.zeros(4))
    assert "found float32[3]" in difference(np.zeros(3), np.zeros(3, np.float32))


def test_nan_is_refused_and_found(case, tmp_path):
    with pytest.raises(ValueError, match="sample: bad is not finite"):
        case.put(bad=np.array([1.0, np.nan]))
    assert difference(np.ones(2), np.array([1.0, np.nan])) != ""
    assert case.differences(tmp_path / "elsewhere") == ["sample: no such case"]
