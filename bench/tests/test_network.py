"""The large frames and the comparison of answers that bench/network relies on."""

import os
import tempfile
import unittest
from pathlib import Path

import numpy as np
import OpenEXR

from .. import derived, network


class Enlarged(unittest.TestCase):
    def test_a_large_frame_keeps_channels_and_types(self):
        source = network.ROOT / "tests/data/sample/denoised.exr"
        before = OpenEXR.File(str(source), separate_channels=True).channels()
        programs = Path(os.environ.get("CARGO_TARGET_DIR", network.ROOT / "target"), "release")
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder, "large.exr")
            derived.mirror(programs / "examples/edit_exr", source, target, 300, 200)
            after = OpenEXR.File(str(target), separate_channels=True).channels()
            self.assertEqual(sorted(before), sorted(after))
            for name, channel in after.items():
                small = before[name].pixels
                self.assertEqual((channel.pixels.shape, channel.pixels.dtype), ((200, 300), small.dtype))
                self.assertEqual(channel.pixels[5, 256], small[5, 255])
                self.assertEqual(channel.pixels[199, 299], small[184, 212])


class Check(unittest.TestCase):
    def test_a_wrong_value_is_seen(self):
        found = np.ones((1, 16, 2 * network.ROW_STEP, 5), np.float32)
        rows = np.ones((2, 16, 5), np.float32)
        self.assertEqual(network.check("right", found, rows.reshape(-1)), 0.0)
        found[0, 3, network.ROW_STEP, 2] += 3 * network.TOLERANCE
        with self.assertRaisesRegex(network.WrongAnswer, "wrong"):
            network.check("wrong", found, rows.reshape(-1))

    def test_the_stages_of_run_are_those_that_its_report_names(self):
        programs = Path(os.environ.get("CARGO_TARGET_DIR", network.ROOT / "target"), "release")
        with tempfile.TemporaryDirectory() as folder:
            for name in ("a.exr", "b.exr", "denoised.exr"):
                source = network.ROOT / "tests/data/sample" / name
                derived.mirror(programs / "examples/edit_exr", source, Path(folder, name), 64, 48)
            model = network.model_for(programs, folder)
            table = network.run_table(network.measure_run(programs, folder, model, 1, 1))
            self.assertIn("### `sspc-infer run`, 64 x 48, file to file", table)

    def test_a_record_is_written_with_every_table(self):
        about = {
            "date": "2026-11-26T10:00:00+00:00",
            "commit": {"hash": "abc1234", "dirty": True},
            "command": "bench/network",
            "machine": {"processor": "P", "cores_usable": 2, "system": "S", "load_average_before": [0.1]},
            "load_average_after": [0.2],
        }
        lines = [dict(name=name, seconds=2.0, core_seconds=4.0) for name in ("picture", "operators")]
        with tempfile.TemporaryDirectory() as folder:
            tables = [network.picture_table(lines), "second"]
            paths = network.write(Path(folder), about, {"pictures": [lines]}, tables, 2)
            self.assertEqual(
                [path.name for path in paths], [f"network-2026-11-26-abc1234-dirty{e}" for e in (".md", ".json")]
            )
            text = paths[0].read_text()
            self.assertIn("| picture | 2.00 | 4.00 | 17.36 | 1.0 |", text)
            self.assertTrue(text.endswith("second\n"))


if __name__ == "__main__":
    unittest.main()
