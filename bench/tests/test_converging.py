"""Tests of bench/convergence: equal times, the record's text, figures, arguments; nothing is rendered."""

import argparse
import contextlib
import importlib.util
import io
import tempfile
import unittest
from pathlib import Path

from ..converging import command, equal, record


def figures(noisy, denoised, corrected, seconds=2.0, steps=300):
    return {
        "noisy": noisy,
        "denoised": denoised,
        "corrected": corrected,
        "seconds": seconds,
        "steps": steps,
        "fallback": None,
    }


# The denoiser's error falls with 1 / samples; a sample takes a second, a denoised picture half of one.
SAMPLES = {"oidn": {8: figures(1.0, 0.08, 0.04), 16: figures(0.5, 0.04, 0.03), 32: figures(0.25, 0.02, 0.018)}}
SECONDS = {"render": {"8": 8.0, "16": 16.0, "32": 32.0}, "denoise": {n: {"oidn": 0.5} for n in ("8", "16", "32")}}
STEPS = {"g_c": {30: figures(0.5, 0.04, 0.03, steps=30)}, "f_c": {30: figures(0.5, 0.04, 0.05, steps=30)}}
ABOUT = {
    "date": "2030-01-02T00:00:00",
    "commit": {"hash": "abc", "dirty": False},
    "command": "bench/convergence",
    "machine": {"processor": "P", "cores_usable": 2, "system": "S", "load_average_before": [0, 0, 0]},
    "load_average_after": [0, 0, 0],
}


def options(**more):
    given = {
        "size": (320, 180),
        "preset": "balanced",
        "set": [],
        "steps_preset": "balanced",
        "steps_spp": 16,
        "denoisers": ["oidn"],
    }
    return argparse.Namespace(**given, reference_spp=1024, **more)


class EqualTime(unittest.TestCase):
    def test_a_row_buys_samples_for_the_seconds_of_a_corrected_frame(self):
        first, _, last = equal.rows(SAMPLES, SECONDS)
        # 8 s of samples, three pictures of 0.5 s and 2 s of fit.
        self.assertAlmostEqual(first.seconds, 11.5)
        # One picture less two: 11 s of samples at a second each.
        self.assertAlmostEqual(first.other_spp, 11.0)
        self.assertAlmostEqual(first.denoised, 0.64 / 11)
        self.assertEqual((first.extrapolated, last.extrapolated), (False, True))


class Record(unittest.TestCase):
    def test_every_table_and_figure_is_named(self):
        found = {"s": {"samples": SAMPLES, "steps": STEPS, "seconds": SECONDS}}
        text = record.markdown(options(), ABOUT, found, "stem")
        for part in ("### Samples", "### Steps", "### Equal time", "stem-s-samples.svg", "stem-s-steps.svg"):
            self.assertIn(part, text)
        self.assertIn("| oidn | 8 | 1 | 0.08 | 0.04 | 0.50 |", text)
        self.assertIn("| f_c | 30 | 0.05 | 1.25 | 2.0 |", text)
        self.assertIn("| oidn | 8 | 11.5 | 0.04 | 11 | 0.0582 | 0.69 |", text)

    def test_a_shared_machine_is_named(self):
        for load, shared in ((2.0, False), (2.1, True)):
            text = record.markdown(options(), ABOUT | {"load_average_after": [load, 0, 0]}, {}, "stem")
            self.assertEqual("was shared" in text, shared, load)

    @unittest.skipUnless(importlib.util.find_spec("matplotlib"), "no matplotlib")
    def test_the_same_figures_give_the_same_files(self):
        from ..converging import plots

        with tempfile.TemporaryDirectory() as folder:
            texts = []
            for name in ("one", "two"):
                plots.by_samples(SAMPLES, "title", Path(folder) / name)
                texts.append((Path(folder) / f"{name}.svg").read_bytes())
            plots.by_steps(STEPS, "title", Path(folder) / "steps")
            self.assertTrue((Path(folder) / "steps.png").is_file())
        self.assertEqual(*texts)


class Arguments(unittest.TestCase):
    def refused(self, *words):
        parsed = command.command_line().parse_args(["--frames", "f", *words])
        said = io.StringIO()
        with contextlib.redirect_stderr(said), self.assertRaises(SystemExit):
            command.check(parsed, needed=())
        return said.getvalue()

    def test_what_makes_no_sense_is_named(self):
        self.assertIn("--scene motion", self.refused("--scene", "motion"))
        self.assertIn("7 samples", self.refused("--spp", "8,7"))
        self.assertIn("--denoisers", self.refused("--denoisers", "magic"))
        self.assertIn("--size", self.refused("--size", "1x1,2x2"))

    def test_a_missing_package_is_named(self):
        parsed = command.command_line().parse_args(["--frames", "f"])
        said = io.StringIO()
        with contextlib.redirect_stderr(said), self.assertRaises(SystemExit):
            command.check(parsed, needed=("no_such_package",))
        self.assertIn("no_such_package", said.getvalue())


if not importlib.util.find_spec("matplotlib"):
    print("skipped: figures of bench/convergence (no matplotlib)")

if __name__ == "__main__":
    unittest.main()
