"""Blender extension: renders two halves with Cycles, corrects them with sspc, shows and saves the picture."""

import bpy

from . import operators, panel, settings

CLASSES = (*settings.CLASSES, *operators.CLASSES, *panel.CLASSES)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.sspc = bpy.props.PointerProperty(type=settings.SceneSettings)
    bpy.types.WindowManager.sspc = bpy.props.PointerProperty(type=settings.State)


def unregister():
    operators.end_all()
    del bpy.types.WindowManager.sspc
    del bpy.types.Scene.sspc
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
