"""Blender Cycles on the CPU: radiance and its denoising albedo and normal. Cycles has no pass for visibility."""

import tempfile
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

from . import cycles_scenes

PASSES = {"color": ("Combined", "RGB"), "albedo": ("Denoising Albedo", "RGB"), "normal": ("Denoising Normal", "XYZ")}


class Renderer:
    """One scene, ready to be rendered again and again."""

    def __init__(self, name, size, depth, threads):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        cycles_scenes.build(name)
        scene = bpy.context.scene
        scene.frame_set(1)
        render, cycles = scene.render, scene.cycles
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
        render.use_persistent_data = True
        render.use_compositing = render.use_sequencer = False
        if threads:
            render.threads_mode, render.threads = "FIXED", threads
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
        render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
        render.image_settings.color_depth = "32"
        cycles.device = "CPU"
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
        # A box filter: no sample reaches a neighbouring pixel, so pixels' noise is independent.
        cycles.pixel_filter_type = "BOX"
        for bounces in ("max", "diffuse", "glossy", "transmission"):
            setattr(cycles, "max_bounces" if bounces == "max" else f"{bounces}_bounces", depth)
        bpy.context.view_layer.cycles.denoising_store_passes = True

    def render(self, spp, seed):
        """Buffers of (height, width, channels) by role."""
        channels = self.channels(spp, seed)
        return {role: plane_of(channels, *names) for role, names in PASSES.items()}

    def channels(self, spp, seed):
        """Every channel of Blender's own file by its name, (height, width)."""
        scene = bpy.context.scene
        scene.cycles.samples, scene.cycles.seed = spp, seed
        with tempfile.TemporaryDirectory() as folder:
            scene.render.filepath = str(Path(folder) / "pass.exr")
            bpy.ops.render.render(write_still=True)
            file = OpenEXR.File(scene.render.filepath, separate_channels=True)
            return {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}


def plane_of(channels, name, letters):
    """Channels of the pass `name`, by the last part of theirs; a view layer's name stands before it."""
    found = {
        key.rpartition(".")[2]: pixels
        for key, pixels in channels.items()
        if key.rpartition(".")[0].endswith(f".{name}")
    }
    return np.stack([found[letter] for letter in letters], -1).astype(np.float64)
