"""What the user can set, and what is going on."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

PRESETS = [
    ("fast", "Fast", "80 steps, small windows"),
    ("balanced", "Balanced", "300 steps"),
    ("quality", "Quality", "1000 steps and more on large pictures"),
]
# Blender 5 asks for this where // may begin a path.
BESIDE_THE_FILE = {"ANIMATABLE"} | ({"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0, 0) else set())


class SceneSettings(bpy.types.PropertyGroup):
    """Settings of a scene, saved with its file."""

    preset: EnumProperty(name="Preset", items=PRESETS, default="balanced", description="How long to train")
    seed: IntProperty(name="Seed", default=1, min=0, description="Of the training: the same seed, the same picture")
    split: BoolProperty(
        name="Split Samples",
        default=True,
        description="Each half takes half of the scene's samples, so that both take as long as one usual render; "
        "off: each half takes all of them",
    )
    strength: FloatProperty(
        name="Strength", default=1.0, min=0.0, max=1.0, subtype="FACTOR", description="Share of the correction used"
    )
    fit_frames: IntProperty(
        name="Frames to Fit",
        default=3,
        min=1,
        max=20,
        description="Of an animation: frames that the model is fitted on, evenly spread; all are corrected with it",
    )
    save: BoolProperty(name="Save Picture", default=True, description="Write the corrected frame to the folder too")
    folder: StringProperty(
        name="Folder",
        default="//corrected/",
        subtype="DIR_PATH",
        options=BESIDE_THE_FILE,
        description="Of corrected.####.exr, made when absent",
    )
    keep: BoolProperty(
        name="Keep Halves",
        default=False,
        description="Keep both halves, the model, its report and the corrected picture with all passes in the folder",
    )


class State(bpy.types.PropertyGroup):
    """What is going on; never saved."""

    running: BoolProperty(options={"SKIP_SAVE"})
    cancel: BoolProperty(options={"SKIP_SAVE"})
    factor: FloatProperty(min=0.0, max=1.0, options={"SKIP_SAVE"})
    text: StringProperty(options={"SKIP_SAVE"})
    # How the last correction ended.
    message: StringProperty(options={"SKIP_SAVE"})
    level: StringProperty(default="INFO", options={"SKIP_SAVE"})


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    programs: StringProperty(
        name="Programs",
        subtype="DIR_PATH",
        description="Folder of sspc-train and sspc-infer; empty: those of this extension, else those on the PATH",
    )

    def draw(self, context):
        self.layout.prop(self, "programs")


def programs_folder(context):
    """The folder that the preferences name; empty where they do not, or where there are none (scripts)."""
    addon = context.preferences.addons.get(__package__)
    folder = getattr(addon.preferences, "programs", "") if addon else ""
    return bpy.path.abspath(folder) if folder else ""


CLASSES = (SceneSettings, State, Preferences)
