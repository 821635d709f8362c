"""Blender Cycles with all its lobes and a light group for every lamp: channels as Blender's own file names them."""

import bpy

from . import cycles_renderer

LOBES = [
    *(f"{lobe}_{part}" for lobe in ("diffuse", "glossy", "transmission") for part in ("direct", "indirect", "color")),
    "emit",
    "environment",
]


class Renderer(cycles_renderer.Renderer):
    """One scene with its passes, ready to be rendered again and again."""

    def __init__(self, name, size, depth, threads):
        super().__init__(name, size, depth, threads)
        layer = bpy.context.view_layer
        for lobe in LOBES:
            setattr(layer, f"use_pass_{lobe}", True)
        layer.cycles.use_pass_volume_direct = layer.cycles.use_pass_volume_indirect = True
        lamps = [made for made in bpy.context.scene.objects if made.type == "LIGHT"]
        for index, lamp in enumerate(lamps):
            lamp.lightgroup = lamp.lightgroup or f"lamp{index}"
        world = bpy.context.scene.world
        world.lightgroup = world.lightgroup or "sky"
        for group in {*(made.lightgroup for made in bpy.context.scene.objects), world.lightgroup} - {""}:
            layer.lightgroups.add(name=group)

    def render(self, spp, seed):
        """Channels by name, (height, width) each."""
        return self.channels(spp, seed)
