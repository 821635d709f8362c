"""Tests of shots as wholes. No built program is needed."""

import contextlib
import io
import json
import os
import sys
import tempfile
import unittest
from pathlib import Path

from .. import command, frames, record, shots
from .test_bench import frame

# A program of two names. The error of a picture is its bytes as a number: own training 4, one model 6, with neighbours
# 3; frame 2 of them 9. The denoiser's is 10.
FAKE = """#!{python}
import json, os, sys
words = sys.argv[1:]
def told(name):
    return words[words.index(name) + 1]
numbers = [int(number) for number in told("--frames").split(",")]
def path(pattern, number):
    return pattern.replace("####", f"{{number:04}}")
if words[0] == "fit":
    if os.environ.get("FAILS") and "--extra-frames" not in words:
        sys.exit("no luck")
    out = told("-o")
    os.makedirs(out, exist_ok=True)
    for number in numbers:
        open(f"{{out}}/corrected.{{number:04}}.exr", "w").write("4")
        report = {{"threads": 2, "seconds": {{"train": 2.0 if len(numbers) == 1 else 1.5}}}}
        json.dump(report, open(f"{{out}}/report.{{number:04}}.json", "w"))
    open(f"{{out}}/model.onnx", "w").write("6" if "--extra-frames" in words else "3")
elif words[0] == "run":
    assert "--extra-frames" not in words
    error = open(told("--model")).read()
    for number in numbers:
        open(path(told("-o"), number), "w").write("9" if number == 2 else error)
else:
    errors = [float(open(path(words[1], number)).read()) for number in numbers]
    each = [
        {{"frame": n, "figures": {{"rel_l2": e}}, "denoised": {{"rel_l2_ratio": e / 10}}, "temporal": 0, "jod": 0}}
        for n, e in zip(numbers, errors)
    ]
    mean = sum(errors) / len(errors)
    own = {{"rel_l2_ratio": mean / 10, "temporal_ratio": 0.5, "crossed_ratio": None, "jod": 9.5}}
    print(json.dumps({{"frames": each, "rel_l2": mean, "jod": 9.0 + mean / 100, "denoised": own}}))
"""


class Shots(unittest.TestCase):
    def test_frames_with_everything_make_a_shot(self):
        with tempfile.TemporaryDirectory() as root:
            for name in ("a", "b", "denoised", "denoised-a", "denoised-b", "ref"):
                for number in (999, 1000, 1001):
                    path = Path(root, "shot", f"{name}.{number:04}.exr")
                    path.parent.mkdir(exist_ok=True)
                    path.touch()
            for name in ("a", "b", "denoised", "ref"):
                Path(root, "shot", f"{name}.1003.exr").touch()
            Path(root, "shot", "ref.1001.exr").unlink()
            (shot,) = shots.of(frames.find(root))
            self.assertEqual((shot.name, shot.listed), ("shot", "999,1000,1003"))
            self.assertEqual(shot.pattern("ref"), f"{root}/shot/ref.####.exr")
            self.assertNotIn("--denoised-a", shot.arguments(), "one frame lacks them")
        self.assertEqual(shots.of([frame("still"), frame("shot/1", shot="shot")]), [])

    def bench(self, *arguments, **environment):
        """Exit code, texts of the record by suffix, standard output, of a benchmark of a shot of three frames."""
        with tempfile.TemporaryDirectory() as folder:
            for name in ("sspc-train", "sspc-infer"):
                path = Path(folder, "bin", name)
                path.parent.mkdir(exist_ok=True)
                path.write_text(FAKE.format(python=sys.executable))
                path.chmod(0o755)
            for name in ("a", "b", "denoised", "ref"):
                for number in (1, 2, 3):
                    path = Path(folder, "frames", "hall", f"{name}.{number:04}.exr")
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.touch()
            output, places = Path(folder, "records"), [f"{folder}/frames", f"{folder}/bin"]
            words = ["--frames", places[0], "--bin-dir", places[1], "-o", str(output), "--only", "hall/*"]
            os.environ.update(environment)
            self.addCleanup(lambda: [os.environ.pop(name, None) for name in environment])
            with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()):
                exit_code = command.main([*words, "--methods", "none", "--no-large", *arguments])
            return exit_code, {path.suffix: path.read_text() for path in output.iterdir()}, out.getvalue()

    def test_three_ways_side_by_side(self):
        exit_code, texts, printed = self.bench()
        self.assertEqual(exit_code, 0)
        found = json.loads(texts[".json"])["shots"]
        self.assertEqual([result["way"] for result in found], list(shots.WAYS))
        lines = {
            line.split(" | ")[2]: line for line in texts[".md"].splitlines() if line.startswith("| hall | balanced")
        }
        # (6 + 9 + 6) / 30; the worst is frame 2, 9 / 4 of its own training. Training: 1.5 s for three, three times 2 s.
        self.assertIn("| 0.700 | 0.500 | - | 9.070 | 9.500 | 2.250 2 |", lines[shots.ALONE])
        self.assertIn("| 0.500 | 0.500 | - | 9.050 | 9.500 | 2.250 2 |", lines[shots.NEIGHBOURS])
        self.assertTrue(lines[shots.NEIGHBOURS].endswith("| 0.50 | 0.25 |"), lines[shots.NEIGHBOURS])
        self.assertIn("| 0.400 | 0.500 | - | 9.040 | 9.500 | 1.000 3 |", lines[shots.EACH])
        self.assertTrue(lines[shots.EACH].endswith("| - | 2.00 | 1.00 |"), lines[shots.EACH])
        self.assertIn("hall  balanced  one model, neighbours", printed)
        self.assertIn("2 threads used", texts[".md"])
        self.assertNotIn("## Goals", texts[".md"], "of frames nothing was measured")

    def test_a_failure_is_told_and_leaves_the_others(self):
        exit_code, texts, _ = self.bench(FAILS="1")
        self.assertEqual(exit_code, 1)
        self.assertIn(f"hall, balanced, seed 1, {shots.NEIGHBOURS}: FAILED: sspc-train fit ended", texts[".md"])
        self.assertIn("no luck", texts[".md"])
        self.assertEqual(len(shots.rows(json.loads(texts[".json"])["shots"])), 2)

    def test_seeds_are_averaged_and_the_worst_frame_is_over_all(self):
        def result(way, seed, error):
            each = [{"frame": 1, "rel_l2": error}, {"frame": 2, "rel_l2": 1.0}]
            own = {"rel_l2_ratio": error, "temporal_ratio": 0.5, "crossed_ratio": None, "jod": 9.0}
            return {
                "shot": "s", "preset": "p", "way": way, "seed": seed, "frames": 2, "failure": None,
                "fit_seconds": 3.0, "train_seconds": 2.0, "run_seconds": 1.0,
                "evaluation": {"frames": each, "denoised": own, "jod": 9.0},
            }  # fmt: skip

        results = [result(way, seed, error) for way, seed, error in (
            (shots.EACH, 1, 1.0), (shots.EACH, 2, 2.0), (shots.ALONE, 1, 1.5), (shots.ALONE, 2, 2.5),
        )]  # fmt: skip
        _, row = shots.rows(results)
        self.assertEqual((row.rel_l2_ratio, row.crossed_ratio, row.worst), (2.0, None, (1.5, 1)))
        self.assertEqual((row.run_seconds_per_frame, row.train_seconds_per_frame), (0.5, 1.0))
        self.assertEqual(shots.text([result(shots.EACH, 1, 1.0) | {"failure": "x"}], record.table), "")
