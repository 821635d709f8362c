"""Renders two halves with Mitsuba 3, denoises them with OIDN and corrects: pip install mitsuba pyoidn."""

import mitsuba as mi
import numpy as np
import pyoidn

import sspc

mi.set_variant("scalar_rgb")
box = mi.cornell_box()
# A box filter: no sample reaches a neighbouring pixel, so the noise of pixels is independent.
box["sensor"]["film"]["rfilter"] = {"type": "box"}
box["integrator"] = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "path": {"type": "path"}}
scene = mi.load_dict(box)


def half(seed):
    buffers = np.array(mi.render(scene, spp=16, seed=seed), dtype=np.float32)
    return [np.ascontiguousarray(buffers[..., first : first + 3]) for first in (0, 3, 6)]


a, b = half(1), half(2)
full = [(x + y) / 2 for x, y in zip(a, b)]
za, zb, z = (pyoidn.denoise(*buffers, hdr=True, quality="high") for buffers in (a, b, full))
frame = dict(a=a[0], b=b[0], albedo_a=a[1], albedo_b=b[1], normal_a=a[2], normal_b=b[2])
frame |= dict(denoised_a=za, denoised_b=zb, denoised=z)
result = sspc.fit(**frame).correct(**frame)
mi.util.write_bitmap("corrected.exr", result.picture)
print(
    f"estimated relL2: {result.estimate.denoised.value:.5f} denoised, {result.estimate.corrected.value:.5f} corrected"
)
