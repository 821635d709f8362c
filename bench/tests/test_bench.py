"""Tests of the benchmark: `python3 -m unittest discover -s bench/tests -t .`. No built program is needed."""

import contextlib
import io
import json
import math
import os
import stat
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ET
from pathlib import Path

from .. import command, figures, frames, goals, jobs, plot, record

# A program of two names that writes what its environment says: the fit's report and the evaluation of its picture.
FAKE = """#!{python}
import json, os, sys
said, found, code = float(os.environ["SAID"]), float(os.environ["FOUND"]), int(os.environ["CODE"])
if sys.argv[1] == "evaluate":
    figures = {{"rel_l2": found}}
    print(json.dumps({{"width": 4, "height": 3, "figures": figures, "denoised": {{"figures": {{"rel_l2": 0.002}}}}}}))
else:
    if code:
        sys.exit("no luck")
    out = sys.argv[sys.argv.index("-o") + 1]
    os.makedirs(out, exist_ok=True)
    rel_l2 = {{"noisy": 0.01, "denoised": 0.002, "corrected": said, "best_mix": {{"share": 0.1, "rel_l2": 0.0019}}}}
    report = {{"width": 4, "height": 3, "threads": 2, "steps": 5, "rel_l2": rel_l2, "history": []}}
    report["seconds"] = {{"total": 0.1}}
    with open(os.path.join(out, "report.json"), "w") as file:
        json.dump(report, file)
"""


def result(frame, column="fast", ratio=0.5, mix=0.9, seconds=1.0, **more):
    rel_l2 = {
        "noisy": 0.1,
        "denoised": 0.01,
        "corrected": 0.01 * ratio,
        "best_mix": {"share": 0.1, "rel_l2": 0.01 * mix},
    }
    return {
        "frame": frame, "method": jobs.SSPC, "preset": column, "column": column, "seed": 1, "repeat": 0,
        "failure": None, "width": 640, "height": 360, "rel_l2": rel_l2, "wall_seconds": seconds, "cpu_seconds": 2.0,
        "peak_rss_bytes": 2**20, "steps": 40, "fallback": None, "threads": 2, "seconds": {"total": seconds},
    } | more  # fmt: skip


def frame(name, shot=None, variant=None, spp=None):
    here = Path(name)
    return frames.Frame(name, here, here, None, reference=here, shot=shot, variant=variant, spp=spp)


class Frames(unittest.TestCase):
    def test_render_times_of_folders(self):
        with tempfile.TemporaryDirectory() as root:
            for scene, text in (("stairs", '{"16spp": 20, "64spp": 80.5}'), ("fur", '{"": 9}')):
                Path(root, scene).mkdir()
                Path(root, scene, "render-seconds.json").write_text(text)
            self.assertEqual(frames.render_seconds(root), {"fur": 9.0, "stairs/16spp": 20.0, "stairs/64spp": 80.5})
            for text in ('{"16spp": 0}', "[1]", '{"16spp": "long"}', "{"):
                Path(root, "fur", "render-seconds.json").write_text(text)
                with self.assertRaises(ValueError):
                    frames.render_seconds(root)

    def test_file_names(self):
        with tempfile.TemporaryDirectory() as root:
            for name in (
                "stairs/16spp.a.exr", "stairs/16spp.b.exr", "stairs/16spp.denoised.exr", "stairs/ref.exr",
                "stairs/256spp.a.exr", "stairs/256spp.b.exr", "stairs/64spp.a.exr",
                "stairs/16spp.no-aux.denoised-a.exr", "stairs/16spp.no-aux.denoised-b.exr",
                "stairs/16spp.no-aux.denoised.exr",
                "shot/a.1002.exr", "shot/b.1002.exr", "shot/a.1001.exr", "shot/b.1001.exr", "shot/ref.1001.exr",
                "fur/a.exr", "fur/b.exr", "fur/denoised-a.exr",
            ):  # fmt: skip
                path = Path(root, name)
                path.parent.mkdir(exist_ok=True)
                path.touch()
            found = {f.name: f for f in frames.find(root)}
            expected = ["fur", "shot/1001", "shot/1002", "stairs/16spp", "stairs/16spp/no-aux", "stairs/256spp"]
            self.assertEqual(list(found), expected)
            own, other = found["stairs/16spp"], found["stairs/16spp/no-aux"]
            self.assertEqual((own.spp, own.denoised_a, own.reference.name), (16, None, "ref.exr"))
            self.assertEqual((other.variant, other.denoised_a.name), ("no-aux", "16spp.no-aux.denoised-a.exr"))
            self.assertEqual(other.denoised.name, "16spp.no-aux.denoised.exr")
            self.assertIsNone(found["shot/1002"].reference)
            self.assertEqual(found["shot/1001"].shot, "shot")
            self.assertEqual(found["fur"].denoised_a.name, "denoised-a.exr")

    def test_sample_is_found(self):
        (sample,) = frames.sample(command.REPOSITORY)
        self.assertTrue(sample.reference.is_file() and sample.denoised.is_file())


class Figures(unittest.TestCase):
    def test_geometric_mean(self):
        self.assertAlmostEqual(figures.geometric_mean([0.5, 2.0, 1.0]), 1.0)
        for bad in ([], [0.0], [-1.0, 1.0], [math.nan], [math.inf]):
            with self.assertRaises(ValueError):
                figures.geometric_mean(bad)

    def test_a_shot_counts_once(self):
        shot = [frame("shot/1", shot="shot"), frame("shot/2", shot="shot")]
        values = {"shot/1": 0.25, "shot/2": 0.25, "still": 1.0}
        self.assertAlmostEqual(figures.mean_over([*shot, frame("still")], lambda f: values[f.name]), 0.5)
        self.assertIsNone(figures.mean_over(shot, lambda f: None))

    def test_the_sample_and_other_denoisings_stay_out_of_the_mean(self):
        whole = frame("stairs/16spp")
        found = [frame("sample"), whole, frame("stairs/16spp/no-aux", variant="no-aux")]
        self.assertEqual(figures.judged(found), [whole])
        self.assertEqual(figures.judged(found[:1]), found[:1])

    def test_cells(self):
        known = figures.cells([
            result("f", seconds=1.0), result("f", seconds=5.0, repeat=1), result("f", seconds=2.0, ratio=2.0, seed=2),
            result("f", failure="broken", ratio=9.0),
        ])  # fmt: skip
        cell = known["f", "fast"]
        self.assertAlmostEqual(cell.ratio, 1.0)
        self.assertEqual((cell.seconds, cell.least_seconds, cell.most_seconds), (2.0, 1.0, 5.0))

    def test_time_left(self):
        self.assertIsNone(jobs.seconds_left([], ["fast"]))
        self.assertAlmostEqual(
            jobs.seconds_left([("fast", 1.0), ("fast", 3.0), ("slow", 8.0)], ["fast", "new"]), 2.0 + 4.0
        )


class Goals(unittest.TestCase):
    def verdicts(self, *results):
        found = [frame(name) for name in dict.fromkeys(r["frame"] for r in results)]
        verdicts = goals.verdicts("fast", found, figures.rows(results, found), figures.cells(results))
        return {v.what: v for v in verdicts}

    def test_met_and_not_met(self):
        good = self.verdicts(result("staircase/64spp", ratio=0.78), result("other", ratio=0.85, seconds=1.9))
        self.assertTrue(good["geometric mean, at least"].met)
        self.assertFalse(good["geometric mean, aim"].met)
        self.assertTrue(
            good["staircase/64spp"].met and good["worst frame"].met and good["below the best fixed mix"].met
        )
        self.assertTrue(good["seconds, slowest frame of 640×360"].met)
        self.assertIsNone(good["seconds, slowest frame of 1280×720"].met)
        bad = self.verdicts(result("harmed", ratio=1.02, mix=0.99), result("slow", ratio=0.5, seconds=2.1))
        self.assertFalse(bad["worst frame"].met or bad["seconds, slowest frame of 640×360"].met)
        self.assertIn("harmed", bad["worst frame"].found)
        self.assertFalse(bad["below the best fixed mix"].met)
        self.assertIsNone(bad["staircase/64spp"].met)

    def test_lacking_frames_decide_nothing_but_harm(self):
        good = self.verdicts(result("f", ratio=0.5), result("g", failure="broken"))
        self.assertIsNone(good["geometric mean, at least"].met)
        self.assertIsNone(good["worst frame"].met)
        self.assertIn("1 lacking", good["geometric mean, at least"].found)
        bad = self.verdicts(result("f", ratio=1.5), result("g", failure="broken"))
        self.assertIs(bad["worst frame"].met, False)

    def test_the_sample_alone_decides_nothing(self):
        alone = self.verdicts(result("sample", ratio=0.5))["geometric mean, at least"]
        self.assertIsNone(alone.met)
        self.assertIn("0.500", alone.found)

    def test_a_mix_that_helps_nowhere_is_no_competitor(self):
        self.assertIsNone(self.verdicts(result("f", ratio=1.0, mix=1.0))["below the best fixed mix"].met)


class Plot(unittest.TestCase):
    def test_well_formed_and_inside(self):
        points = tuple(
            plot.Point(f"<p{i}> & co", seconds, ratio)
            for i, (seconds, ratio) in enumerate([(1, 0.9), (600, 0.5), (6, 1e-3)])
        )
        for series in ([plot.Series("a & b", points)], [plot.Series("one", points[:1])]):
            root = ET.fromstring(plot.svg("x < y", "", series, [plot.Level("denoiser", 1.0)]))
            circles = root.findall("{http://www.w3.org/2000/svg}circle")
            self.assertEqual(len(circles), len(series[0].points))
            for circle in circles:
                self.assertTrue(plot.LEFT <= float(circle.get("cx")) <= plot.WIDTH - plot.RIGHT)
                self.assertTrue(plot.TOP <= float(circle.get("cy")) <= plot.HEIGHT - plot.BOTTOM)

    def test_less_error_is_lower_and_ticks_are_on_the_axis(self):
        axis = plot.Axis([0.5, 1.0], 400, 100)
        self.assertGreater(axis.at(0.5), axis.at(1.0))
        for values in ([0.5, 1.0], [0.9, 1.0], [0.62], [1, 3000], [0.001, 7], [20, 25]):
            axis = plot.Axis(values, 0, 100)
            self.assertTrue(2 <= len(axis.ticks()) <= 14, (values, axis.ticks()))
            self.assertTrue(all(-1e-6 <= axis.at(tick) <= 100 + 1e-6 for tick in axis.ticks()), (values, axis.ticks()))

    def test_needs_a_point(self):
        with self.assertRaises(ValueError):
            plot.svg("", "", [], [])


class Records(unittest.TestCase):
    def test_table_escapes_bars_and_has_equal_columns(self):
        lines = record.table(["a", "b"], [["x|y", 1]]).splitlines()
        self.assertEqual(lines[-1], "| x\\|y | 1 |")
        self.assertEqual({line.replace("\\|", "").count("|") for line in lines}, {3})

    def test_never_overwrites(self):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "day.md").touch()
            Path(folder, "day-2.json").touch()
            self.assertEqual(record.free_stem(folder, "day"), "day-3")


class WholeCommand(unittest.TestCase):
    """The command with programs that only pretend: a good run, a failing one, one that lies about its picture."""

    def bench(self, said="0.0015", found="0.0015", code="0", arguments=()):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("sspc-train", "sspc-infer"):
                path = Path(folder, name)
                path.write_text(FAKE.format(python=sys.executable))
                path.chmod(path.stat().st_mode | stat.S_IXUSR)
            os.environ.update(SAID=said, FOUND=found, CODE=code)
            output = Path(folder, "records")
            words = ["--bin-dir", folder, "-o", str(output), "--methods", "sspc", "--presets", "fast", *arguments]
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
                exit_code = command.main(words)
            texts = {path.suffix: path.read_text() for path in output.iterdir()}
            self.assertNotIn(folder, json.dumps(json.loads(texts[".json"])["results"]))
            return exit_code, texts, errors.getvalue()

    def test_good(self):
        exit_code, texts, _ = self.bench(arguments=["--repeat", "2"])
        self.assertEqual(exit_code, 0)
        self.assertIn("| sample | 5.0 | 0.00200 | 0.950 | 0.750 |", texts[".md"])
        self.assertEqual(len(json.loads(texts[".json"])["results"]), 2)
        ET.fromstring(texts[".svg"])

    def test_rounding_to_half_floats_passes(self):
        self.assertEqual(self.bench(said="0.0015", found="0.0015009")[0], 0)

    def test_a_wrong_answer_fails_loudly(self):
        exit_code, texts, errors = self.bench(said="0.0015", found="0.00151")
        self.assertEqual(exit_code, 1)
        self.assertIn("FAILED", errors)
        self.assertIn("the run says 0.0015, the file written has 0.00151", texts[".md"])
        self.assertNotIn(".svg", texts)

    def test_an_exit_code_fails_loudly(self):
        exit_code, texts, errors = self.bench(code="4")
        self.assertEqual(exit_code, 1)
        self.assertIn("exit code", errors)
        self.assertIn("no luck", texts[".md"])


if __name__ == "__main__":
    unittest.main()
