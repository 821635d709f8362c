"""Mitsuba 3: radiance and the features of the first hit. Needs a recent libLLVM (see the README)."""

import tempfile
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

VARIANT = "llvm_ad_rgb"
mi.set_variant(VARIANT)

from . import mitsuba_scenes  # noqa: E402 (its classes are the variant's)


class FirstHit(mi.SamplingIntegrator):
    """The path tracer's radiance; albedo, shading normal and visibility of the lights at the first hit."""

    def __init__(self, properties, radiance):
        super().__init__(properties)
        self.radiance = radiance

    def aov_names(self):
        return [*(f"albedo.{c}" for c in "RGB"), *(f"normal.{c}" for c in "XYZ"), "visibility.Y"]

    def sample(self, scene, sampler, ray, medium=None, active=True):
        value, valid, _ = self.radiance.sample(scene, sampler, mi.RayDifferential3f(ray), medium, active)
        hit = scene.ray_intersect(mi.Ray3f(ray), active)
        arrived = active & hit.is_valid()
        bsdf = hit.bsdf()
        albedo = bsdf.eval_diffuse_reflectance(hit, arrived)
        # Glass and mirrors have no albedo of their own: white, as other renderers write it.
        opaque = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) & ~mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission)
        albedo = dr.clip(dr.select(opaque, albedo, 1.0), 0.0, 1.0)
        normal = dr.select(arrived, hit.sh_frame.n, 0.0)
        toward, weight = scene.sample_emitter_direction(hit, sampler.next_2d(arrived), True, arrived)
        # A ray through the surface itself would miss it: light from behind an opaque surface is not seen.
        before = dr.dot(hit.n, toward.d) * dr.dot(hit.n, ray.d) < 0
        seen = arrived & (toward.pdf > 0) & dr.any(weight != 0) & (before | ~opaque)
        albedo = dr.select(arrived, albedo, 0.0)
        return value, valid, [albedo.x, albedo.y, albedo.z, normal.x, normal.y, normal.z, dr.select(seen, 1.0, 0.0)]


class Renderer:
    """One scene, ready to be rendered again and again."""

    integrator_class = FirstHit

    def __init__(self, name, size, depth, threads):
        if threads:
            dr.set_thread_count(threads)
        with tempfile.TemporaryDirectory() as folder:
            objects, (origin, target, degrees) = self.built(name, Path(folder))
            inside = {"medium": {"type": "ref", "id": "medium"}} if "medium" in objects else {}
            sensor = {
                "type": "perspective",
                "fov": degrees,
                "fov_axis": "y",
                "to_world": mitsuba_scenes.look(origin, target),
                "sampler": {"type": "independent"},
                # A box filter: no sample reaches a neighbouring pixel, so pixels' noise is independent.
                "film": {
                    "type": "hdrfilm",
                    "width": size[0],
                    "height": size[1],
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
            }
            self.scene = mi.load_dict({"type": "scene", **objects, "sensor": sensor | inside})
        path = mi.load_dict({"type": "volpath" if inside else "path", "max_depth": depth})
        self.integrator = self.integrator_class(mi.Properties(), path)

    def built(self, name, folder):
        """Objects and camera; `folder` is for mesh files."""
        return mitsuba_scenes.build(name, folder)

    def render(self, spp, seed):
        """Buffers of (height, width, channels) by role."""
        return roles(self.picture(spp, seed))

    def picture(self, spp, seed):
        """All channels, (height, width, channels)."""
        return np.array(mi.render(self.scene, integrator=self.integrator, spp=spp, seed=seed), dtype=np.float64)


def roles(picture):
    """The parts of a picture that every scene has."""
    parts = {"color": slice(0, 3), "albedo": slice(3, 6), "normal": slice(6, 9), "visibility": slice(9, 10)}
    return {role: picture[..., part] for role, part in parts.items()}
