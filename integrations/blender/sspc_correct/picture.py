"""The corrected picture in Blender: read from its file, shown as an image, saved without the other passes."""

import bpy
import numpy as np

from . import exr

# Of the image in Blender's file.
IMAGE = "sspc corrected"


def read(path, report):
    """The picture as (height, width, 4), the bottom row first, with the alpha of its pass."""
    colour = next(
        role["channels"] for role in report["roles"] if role["role"] == "radiance" and role["buffer"] == "half a"
    )
    alpha = colour[0][:-1] + "A"
    try:
        pixels = exr.read(path, [*colour, alpha])
    except exr.Missing:
        pixels = exr.read(path, colour)
        pixels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1)
    return np.ascontiguousarray(pixels[::-1])


def show(pixels, frame):
    """The image `sspc corrected` with these pixels, in the first Image Editor."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.get(IMAGE)
    if image and (tuple(image.size) != (width, height) or not image.is_float):
        bpy.data.images.remove(image)
        image = None
    if not image:
        image = bpy.data.images.new(IMAGE, width, height, alpha=True, float_buffer=True)
    image.alpha_mode = "PREMUL"
    image.pixels.foreach_set(pixels.ravel())
    image["frame"] = frame
    image.update()
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.spaces.active.image = image
                return image
    return image


def save(image, path):
    """Writes the image as an OpenEXR file, under another name first."""
    unfinished = path.with_name(f".{path.name}.part.exr")
    image.file_format = "OPEN_EXR"
    image.filepath_raw = str(unfinished)
    try:
        image.save()
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    image.filepath_raw = str(path)
