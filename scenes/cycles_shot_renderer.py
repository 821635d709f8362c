"""One frame of a shot by Blender Cycles, with its Vector pass where nothing is blurred by motion."""

import bpy

from . import cycles_renderer

# Largest number of light bounces.
DEPTH = 10


class Renderer(cycles_renderer.Renderer):
    """One frame, ready to be rendered again and again."""

    def __init__(self, name, number, size, threads):
        super().__init__(name, size, DEPTH, threads)
        scene = bpy.context.scene
        # Cameras that are bound to markers change with it.
        scene.frame_set(number)
        bpy.context.view_layer.use_pass_vector = self.has_motion = not scene.render.use_motion_blur

    def render(self, spp, seed):
        """Buffers of (height, width, channels) by role."""
        channels = self.channels(spp, seed)
        passes = cycles_renderer.PASSES | ({"motion": ("Vector", "XYZW")} if self.has_motion else {})
        return {role: cycles_renderer.plane_of(channels, *names) for role, names in passes.items()}
