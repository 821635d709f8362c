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


if __name__ == "__main__":
    unittest.main()
