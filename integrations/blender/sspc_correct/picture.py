"""The corrected picture in Blender: read from the programs' file, and shown as an image."""

import bpy
import numpy as np

from . import exr

# Of the image in Blender's file.
IMAGE = "sspc corrected"


def read(path, report):
    """The picture as (height, width, 4), the top row first, with the alpha of its pass."""
    noisy = [role for role in report["roles"] if role["role"] == "noisy colour" and role["buffer"] == "half a"]
    # The programs put the picture where compositors look for it, into the pass Combined of the noisy colour's layer.
    layer = noisy[0]["channels"][0].rpartition(".")[0].rpartition(".")[0]
    colour, alpha = [f"{layer}.Combined.{component}" for component in "RGB"], f"{layer}.Combined.A"
    try:
        pixels = exr.read(path, [*colour, alpha])
    except exr.Missing:
        pixels = exr.read(path, colour)
        pixels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1)
    return pixels


def show(pixels, path):
    """The image `sspc corrected`: the file at `path` where it was saved, else these pixels; in an Image Editor."""
    old = bpy.data.images.get(IMAGE)
    if path:
        image = bpy.data.images.load(str(path))
    else:
        height, width = pixels.shape[:2]
        image = bpy.data.images.new(IMAGE, width, height, alpha=True, float_buffer=True)
        image.alpha_mode = "PREMUL"
        image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1]).ravel())
        image.update()
    if old:
        # Whatever shows the last picture shows this one.
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name = IMAGE
    # Toned like the render that it is compared with.
    image.use_view_as_render = True
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.spaces.active.image = image
                return
