"""Tests of a record's other sections: samples for equal error, predictions, ablations, derived frames."""

import struct
import tempfile
import unittest
import xml.etree.ElementTree as ET
from pathlib import Path

from .. import ablations, calibration, command, common, derived, equal_time, jobs, plot, record, same_work, scatter
from .test_bench import frame, result


def predicted(name, estimate, halves=(0.02, 0.01), **more):
    """A result with an estimate, (value, standard error) by what, and the true relL2 of the means of both halves."""
    means = {what: {"value": value, "standard_error": error} for what, (value, error) in estimate.items()}
    out = result(name, report={"estimate": means}, **more)
    out["rel_l2"]["halves"] = dict(zip(("denoised", "corrected"), halves))
    return out


def record_of(*results):
    columns = list(dict.fromkeys((r["column"], r["method"], r["preset"]) for r in results))
    return record.Record({}, [frame("f"), frame("g")], columns, list(results), lambda _: None)


class EqualTime(unittest.TestCase):
    def test_samples_on_between_and_beyond_the_steps(self):
        # relL2 = 1 / samples, then twice as steep.
        ladder = equal_time.Ladder(((16, 1 / 16), (64, 1 / 64), (256, 1 / 1024)), None)
        for samples, error in ((16, 1 / 16), (32, 1 / 32), (64, 1 / 64), (128, 1 / 256), (512, 1 / 4096), (8, 1 / 8)):
            self.assertAlmostEqual(ladder.samples_for(error), samples)

    def test_scenes_with_one_step_borrow_the_slope(self):
        known = equal_time.ladders([("a", 16, 0.1), ("a", 64, 0.05), ("b", 64, 0.2), ("c", None, 0.1)])
        self.assertEqual(set(known), {"a", "b"})
        # a falls with samples to the power of -1/2: half the error, four times the samples.
        self.assertAlmostEqual(known["b"].samples_for(0.1), 256)
        self.assertIsNone(equal_time.ladders([("b", 64, 0.2)])["b"].samples_for(0.1))
        self.assertIsNone(equal_time.ladders([("b", 16, 0.1), ("b", 64, 0.2)])["b"].samples_for(0.05))

    def test_equal_time(self):
        bought = equal_time.equal_time(0.08, 16, 10.0, 30.0, [(16, 0.02), (256, 0.005)])
        self.assertAlmostEqual(bought.factor, 4.0)
        self.assertAlmostEqual(bought.noisy, 0.02)
        # 64 spp is half way between 16 and 256 in log: the geometric mean of both errors.
        self.assertAlmostEqual(bought.denoised, 0.01)
        self.assertIsNone(equal_time.equal_time(0.08, 16, 10.0, 30.0, [(16, 0.02)]).denoised)

    def test_worth(self):
        ladder = equal_time.Ladder(((16, 0.1), (64, 0.05)), None)
        w = equal_time.worth("f", 16, 0.8, 0.05, "fast", 3.0, ladder)
        self.assertAlmostEqual(w.noisy_factor, 16)
        self.assertAlmostEqual(w.denoised_factor, 4)
        # 48 samples more for 3 seconds.
        self.assertAlmostEqual(w.break_even, 3 / 48)
        worse = equal_time.worth("f", 16, 0.8, 0.2, "fast", 3.0, ladder)
        self.assertLess(worse.denoised_factor, 1)
        self.assertIsNone(worse.break_even)


class Calibration(unittest.TestCase):
    def test_truth_is_of_the_same_pictures(self):
        both = {"denoised": (0.021, 0.002), "corrected": (0.008, 0.001), "gain": (0.013, 0.002)}
        found = {p.what: p for p in calibration.predictions([predicted("f", both)])}
        self.assertEqual([found[what].truth for what in calibration.WHATS], [0.02, 0.01, 0.01])
        self.assertEqual([found[what].within(1) for what in calibration.WHATS], [True, False, False])
        self.assertEqual([found[what].within(2) for what in calibration.WHATS], [True, True, True])

    def test_a_frame_without_the_halves_figures_has_no_prediction(self):
        unknown = predicted("f", {"denoised": (0.02, 0.001), "corrected": (0.01, 0.001), "gain": (0.01, 0.001)})
        del unknown["rel_l2"]["halves"]
        self.assertEqual(calibration.predictions([unknown]), [])

    def test_the_denoised_picture_counts_once_a_frame_and_failures_never(self):
        both = {"denoised": (0.02, 0.001), "corrected": (0.01, 0.001), "gain": (0.01, 0.001)}
        results = [
            predicted("f", both),
            predicted("f", both, column="slow"),
            predicted("g", both, failure="broken"),
            result("old"),
        ]
        whats = [p.what for p in calibration.predictions(results)]
        self.assertEqual((whats.count(calibration.DENOISED), whats.count(calibration.CORRECTED)), (1, 2))

    def test_coverage(self):
        def p(predicted, error, truth):
            return calibration.Prediction("f", "fast", calibration.GAIN, predicted, error, truth)

        c = calibration.coverage([p(1.0, 1.0, 1.5), p(1.0, 1.0, 2.5), p(-1.0, 1.0, 3.0), p(2.0, None, 4.0)])
        self.assertEqual((c.count, c.within_one, c.within_two), (4, 1 / 3, 2 / 3))
        self.assertEqual((c.not_positive, c.wrong_sign), (1, 1))
        with self.assertRaises(ValueError):
            calibration.coverage([])

    def test_the_plot_marks_negative_predictions_at_the_border(self):
        both = {"denoised": (0.02, 0.03), "corrected": (-0.01, 0.001), "gain": (0.03, 0.001)}
        drawn = ET.fromstring(scatter.svg("t", "s", calibration.predictions([predicted("f & g", both)])))
        place = "{http://www.w3.org/2000/svg}"
        self.assertEqual(len(drawn.findall(f"{place}circle")), 2)
        (corners,) = drawn.findall(f"{place}polygon")
        lowest = max(float(corner.split(",")[1]) for corner in corners.get("points").split())
        self.assertEqual(lowest, scatter.BOTTOM)
        for circle in drawn.findall(f"{place}circle"):
            self.assertTrue(scatter.TOP <= float(circle.get("cy")) <= scatter.BOTTOM)
        self.assertIsNone(scatter.svg("t", "s", []))


class Ablations(unittest.TestCase):
    def results(self, names, variants, cpu=2.0):
        return [
            result(name, column=jobs.column(ablations.title(v), "balanced"), ratio=0.5 + 0.01 * i, cpu_seconds=cpu + i)
            for name in names
            for i, v in enumerate(variants)
        ]

    def test_means_are_over_whole_rows(self):
        results = self.results(["a", "b"], ablations.VARIANTS) + self.results(["c"], ablations.VARIANTS[:3])
        done = ablations.Ablations({}, [frame(n) for n in "abc"], {}, "balanced", results)
        self.assertEqual([f.name for f in done.frames], ["a", "b"])
        lines = done.table(record.table).splitlines()
        self.assertEqual(len(lines), 2 + len(ablations.VARIANTS))
        self.assertIn("| as it is | 0.500 | 1.000 | 1.000 b | 2.0 | 1.00 |", lines[2])
        self.assertIn("| 0.510 | 1.020 | 1.020 b | 3.0 | 1.50 |", lines[3])
        self.assertEqual(len(done.frame_table(record.table).splitlines()), 2 + len(ablations.VARIANTS))

    def test_the_worst_frame_is_the_one_that_a_change_harms_most(self):
        results = self.results(["good", "bad"], ablations.VARIANTS)
        good, bad = (
            next(r for r in results if r["frame"] == name and "f_c" in r["column"]) for name in ("good", "bad")
        )
        good["rel_l2"]["corrected"] = 0.25 * good["rel_l2"]["denoised"]
        bad["rel_l2"]["corrected"] = 1.0 * bad["rel_l2"]["denoised"]
        done = ablations.Ablations({}, [frame("good"), frame("bad")], {}, "balanced", results)
        # Half the error on one frame and twice on the other: nothing in the mean.
        self.assertIn("| f_c (Deep Combiner) | 0.500 | 1.000 | 2.000 bad |", done.table(record.table))

    def test_every_variant_and_every_pair_of_skips_is_run_once_on_every_frame(self):
        half_empty = {"a": frame("a/half-empty")}
        todo = ablations.jobs([frame("a"), frame("b")], half_empty, "balanced", [1])
        off = sum(not pair.half_empty for pair in ablations.PAIRS)
        self.assertEqual(len(todo), 2 * (len(ablations.VARIANTS) + off) + 2)
        self.assertEqual(len({(j.frame.name, j.column) for j in todo}), len(todo))

    def test_skips_are_means_over_the_frames_that_have_both(self):
        half_empty = {name: frame(f"{name}/half") for name in "ab"}
        results = self.results(["a", "b"], ablations.VARIANTS)
        (pair,) = (pair for pair in ablations.PAIRS if pair.half_empty)
        results += self.results(["a/half", "b/half"], [pair.off, pair.on]) + self.results(["a/half"], [pair.off])
        for r in results:
            if r["frame"] == "b/half" and pair.on.name in r["column"]:
                r["failure"] = "broken"
        done = ablations.Ablations({}, [frame("a"), frame("b")], half_empty, "balanced", results)
        lines = done.skip_table(record.table).splitlines()
        self.assertEqual(len(lines), 3)
        self.assertIn("| 1 | 2.0 | 3.0 | 1.50 | 1.50 a/half | 1.020 | 1.020 a/half |", lines[2])

    def test_of_a_shot_the_first_frame(self):
        found = [frame("s/1", shot="s"), frame("s/2", shot="s"), frame("still"), frame("still/x", variant="x")]
        self.assertEqual([f.name for f in ablations.chosen(found)], ["s/1", "still"])


class OfTheWholePicture(unittest.TestCase):
    """Figures that stand in tables of their own."""

    def one(self, name, brightness, crossed=None):
        return result(
            name, evaluated={"brightness": brightness}, evaluated_denoised={"brightness": 0.995}, crossed_ratio=crossed
        )

    def test_brightness_in_per_cent_of_the_reference(self):
        found = record_of(self.one("f", 0.98), self.one("f", 0.99) | {"seed": 2}, result("g")).brightness_table()
        self.assertIn("| f | -0.50 | -1.50 |", found)
        self.assertNotIn("| g |", found, "what was not measured has no row")

    def test_the_figure_across_halves_and_its_mean(self):
        found = record_of(self.one("f", 1, 0.5), self.one("g", 1, 0.72)).crossed_table()
        self.assertIn("| f | 0.500 |", found)
        self.assertIn("| **geometric mean, 2 frames** | 0.600 |", found)


class SameWork(unittest.TestCase):
    def test_others_are_held_against_pytorch_on_its_frames(self):
        torch = result("f", jobs.TORCH, ratio=2.0, cpu_seconds=300.0)
        ours = [result(name, jobs.PAPER, ratio=1.0, cpu_seconds=10.0) for name in "fg"]
        found = same_work.figures(record_of(torch, *ours, result("f", "fast")))
        self.assertEqual([(f["frame"], f["column"]) for f in found], [("f", jobs.TORCH), ("f", jobs.PAPER)])
        self.assertAlmostEqual(found[1]["times_faster"], 30)
        self.assertAlmostEqual(found[1]["ratio_to_torch"], 0.5)
        self.assertIn("| 1.000 | 0.50 | 10.0 | 30.0 |", same_work.text(record_of(torch, *ours), record.table))

    def test_without_pytorch_there_is_nothing_to_say(self):
        failed = result("f", jobs.TORCH, failure="broken")
        self.assertEqual(same_work.text(record_of(failed, result("f", jobs.PAPER)), record.table), "")


class Methods(unittest.TestCase):
    def test_methods_keep_to_their_frames(self):
        found = [frame("sample"), frame("stairs/64spp"), frame("stairs/large", variant="2x2")]
        found[2] = derived.dataclasses.replace(found[2], reference=None)
        methods = jobs.methods(("sspc", "fc", "paper", "torch"), ("fast",), [], None, ("stairs/*",), ("sample",), 9)
        run = {(j.frame.name, j.column) for j in jobs.jobs(found, methods, [1], 1)}
        slow = {("stairs/64spp", jobs.PAPER), ("sample", jobs.TORCH)}
        ours = {(f.name, "fast") for f in found} | {(f.name, "f_c, balanced") for f in found[:2]}
        self.assertEqual(run, slow | ours)
        self.assertEqual(methods[-1].limit, 9)

    def test_a_record_names_no_folder_of_this_machine(self):
        words = ["--bin-dir", "/x", "--only", "a", "-o", "/y", "--keep=/z", "--methods", "fc"]
        self.assertEqual(common.shown("bench/run", words), "bench/run --only a --methods fc")


class Derived(unittest.TestCase):
    def test_size_of_a_file(self):
        (sample,) = command.frames.sample(command.REPOSITORY)
        self.assertEqual(derived.size(sample.a), (256, 192))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "x.exr")
            for data in (b"text", b"\x76\x2f\x31\x01" + struct.pack("<i", 2) + b"\0"):
                path.write_bytes(data)
                with self.assertRaises(derived.NoTool):
                    derived.size(path)

    def test_quarters_cover_the_frame_and_keep_its_kind(self):
        (sample,) = command.frames.sample(command.REPOSITORY)
        with tempfile.TemporaryDirectory() as folder:
            tool = Path(folder, "edit_exr")
            # In its place a program that writes what it was told.
            tool.write_text('#!/bin/sh\nshift 2\necho "$@" > "$1"\n')
            tool.chmod(0o755)
            odd = [derived.quarter(sample, tool, folder, index) for index in range(4)]
            self.assertEqual([f.name for f in odd], [f"sample/quarter-{n}" for n in (1, 2, 3, 4)])
            self.assertEqual([f.variant for f in odd], [None] * 4)
            told = [f.a.read_text().split()[1:] for f in odd]
        self.assertEqual(
            told,
            [["0", "0", "128", "96"], ["128", "0", "128", "96"], ["0", "96", "128", "96"], ["128", "96", "128", "96"]],
        )

    def test_without_the_tool_the_reason_is_said(self):
        with self.assertRaisesRegex(derived.NoTool, "--examples"):
            derived.fourfold(frame("f"), Path("no-such-program"), "folder")


class Notes(unittest.TestCase):
    def test_a_plot_says_its_notes(self):
        series = [plot.Series("one", (plot.Point("p", 1.0, 0.5),))]
        self.assertIn("noisy, above the axis 7", plot.svg("t", "s", series, [], ["noisy, above the axis 7"]))
