"""Mitsuba 3 with finite differences: samples are evaluated one pixel right and below too, by the same numbers.

That is the shift in primary sample space: the film moves by exactly one pixel under the same seed of an independent
sampler. Both evaluations are unbiased, so dx and dy are; where the paths stay alike their noise cancels.
"""

import mitsuba as mi
import numpy as np

from . import mitsuba_renderer

# The principal point's offset, in pixels, that shows what lies one pixel right (x) or below (y).
RIGHT, BELOW = (1, 0), (0, 1)


class Renderer(mitsuba_renderer.Renderer):
    """One scene with its differences, ready to be rendered again and again."""

    def __init__(self, name, size, depth, threads):
        super().__init__(name, size, depth, threads)
        self.size = size
        self.parameters = mi.traverse(self.scene)

    def render(self, spp, seed):
        """Buffers of (height, width, channels) by role, with dx = y(x + 1) - y(x) and dy = y(below) - y.

        Both are defined in the last column and row too: what they show lies beyond the film.
        """
        self.shift((0, 0))
        buffers = super().render(spp, seed)
        for role, shift in (("dx", RIGHT), ("dy", BELOW)):
            self.shift(shift)
            picture = mi.render(self.scene, integrator=self.integrator.radiance, spp=spp, seed=seed)
            buffers[role] = np.array(picture, dtype=np.float64)[..., :3] - buffers["color"]
        return buffers

    def shift(self, pixels):
        """Moves the picture by so many pixels (right, down) on the film."""
        for axis, pixel, extent in zip("xy", pixels, self.size, strict=True):
            self.parameters[f"sensor.principal_point_offset_{axis}"] = pixel / extent
        self.parameters.update()
