"""Renders a small frame with differences many times: `python -m unittest scenes.test_gradients`; needs Mitsuba."""

import importlib.util
import unittest

import numpy as np

SIZE = (36, 24)
SEEDS = 48
SAMPLES = 16
# A mean of squared standardised errors, 1 where all of an error is noise; of some thousand values with heavy tails.
MOST_NOISE = 1.5
# Errors count as no larger than so many standard errors: with few seeds a firefly has none to be measured by.
LARGEST = 4


@unittest.skipUnless(importlib.util.find_spec("mitsuba"), "needs Mitsuba (scenes/requirements.txt)")
class Differences(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        from scenes.mitsuba_gradients_renderer import Renderer

        renderer = Renderer("door-crack", SIZE, 4, 1)
        frames = [renderer.render(SAMPLES, 7919 + seed) for seed in range(SEEDS)]
        cls.color, cls.dx, cls.dy = (np.stack([frame[role] for frame in frames]) for role in ("color", "dx", "dy"))

    def standardised(self, given, other):
        """Errors of the mean of `given` against that of `other`, from other seeds, in standard errors."""
        given, other = given[::2], other[1::2]
        variance = given.var(0, ddof=1) / len(given) + other.var(0, ddof=1) / len(other)
        error = (given.mean(0) - other.mean(0)) / np.sqrt(np.maximum(variance, 1e-12))
        return np.clip(error, -LARGEST, LARGEST)

    def test_the_mean_of_differences_is_the_difference_of_the_mean(self):
        for given, difference in (
            (self.dx[:, :, :-1], np.diff(self.color, axis=2)),
            (self.dy[:, :-1], np.diff(self.color, axis=1)),
        ):
            self.assertLess(np.mean(self.standardised(given, difference) ** 2), MOST_NOISE)
            # The test can fail: the other sign, and the neighbour's.
            self.assertGreater(np.mean(self.standardised(-given, difference) ** 2), MOST_NOISE)
            moved = np.roll(given, 1, axis=2 if given.shape[2] < SIZE[0] else 1)
            self.assertGreater(np.mean(self.standardised(moved, difference) ** 2), MOST_NOISE)

    def test_differences_are_quiet_where_the_picture_is_smooth_and_not_at_edges(self):
        ratio = self.dx[:, :, :-1].var(0).mean(-1) / np.diff(self.color, axis=2).var(0).mean(-1)
        # Pixels of so small a picture are coarse: half of them see an edge.
        self.assertLess(np.quantile(ratio, 0.25), 0.4)
        self.assertGreater(np.quantile(ratio, 0.97), 0.8)


if __name__ == "__main__":
    unittest.main()
