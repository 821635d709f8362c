"""The committed parity cases are what this code makes."""

import make_cases


def test_committed_cases_are_regenerated_the_same(capsys):
    assert make_cases.main(["--check"]) == 0, capsys.readouterr().out
