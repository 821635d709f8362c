"""Tests of the extension inside Blender; test_blender.py runs them with an interpreter that has bpy.

SSPC_SCRATCH names an empty folder, BLENDER_USER_RESOURCES another, and the programs are on the PATH.
"""

import importlib
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import bpy
import numpy as np

SOURCE = Path(__file__).with_name("sspc_correct")
SCRATCH = Path(os.environ["SSPC_SCRATCH"])
PACKAGE = "bl_ext.user_default.sspc_correct"
WIDTH, HEIGHT, SAMPLES = 256, 160, 32
# Cycles' own names of what is on only while halves are rendered.
KINDS = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}


def setUpModule():
    """Builds the package with Blender's own tool and installs it as a user does."""
    tool = Path(bpy.utils.system_resource("SCRIPTS"), "addons_core", "bl_pkg", "cli", "blender_ext.py")
    for command in (["validate", SOURCE], ["build", "--source-dir", SOURCE, "--output-dir", SCRATCH]):
        subprocess.run([sys.executable, tool, *command], check=True)
    # Blender as a module starts without the add-on that installs extensions.
    bpy.ops.preferences.addon_enable(module="bl_pkg")
    package = next(SCRATCH.glob("sspc_correct-*.zip"))
    bpy.ops.extensions.package_install_files(filepath=str(package), repo="user_default", enable_on_install=True)


def scene_with_texture(engine="CYCLES"):
    """A lit floor and three balls with checks, one of them glossy; few samples, so that there is noise."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=12)
    bpy.context.view_layer.objects.active.data.materials.append(material("floor", 0.6))
    for at, roughness in enumerate((0.9, 0.5, 0.1)):
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.7, location=(1.6 * at - 1.6, 0, 0.7))
        bpy.context.view_layer.objects.active.data.materials.append(material(f"ball {at}", roughness))
    light = bpy.data.objects.new("light", bpy.data.lights.new("light", "AREA"))
    light.data.energy, light.data.size, light.location = 400, 0.5, (2, -2, 4)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (0, -6, 3), (1.1, 0, 0)
    for made in (light, camera):
        scene.collection.objects.link(made)
    scene.camera = camera
    render, cycles = scene.render, scene.cycles
    render.engine, cycles.device, cycles.samples, cycles.seed = engine, "CPU", SAMPLES, 5
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    # What a user may have and wants back.
    cycles.use_denoising = False
    render.filepath = "//mine/####.png"
    scene.frame_start, scene.frame_end = 1, 3
    scene.frame_set(2, subframe=0.25)
    scene.sspc.preset, scene.sspc.keep, scene.sspc.folder = "fast", True, tempfile.mkdtemp(dir=SCRATCH)
    return scene


def material(name, roughness):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Roughness"].default_value = roughness
    texture = nodes.new("ShaderNodeTexChecker")
    texture.inputs["Scale"].default_value = 6
    links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    return made


def settings_of(scene):
    """Every simple setting of what the extension touches."""
    owners = {"render": scene.render, "cycles": scene.cycles, "image": scene.render.image_settings, "scene": scene}
    for layer in scene.view_layers:
        owners |= {layer.name: layer, f"{layer.name} cycles": layer.cycles}
    found = {}
    for name, owner in owners.items():
        for setting in owner.bl_rna.properties:
            if setting.type in KINDS and not setting.is_readonly:
                value = getattr(owner, setting.identifier)
                found[name, setting.identifier] = tuple(value) if hasattr(value, "__len__") else value
    drivers = scene.animation_data.drivers if scene.animation_data else []
    return found | {("mute", curve.data_path): curve.mute for curve in drivers}


def state():
    return bpy.context.window_manager.sspc


def files(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def passes(path, name):
    """A pass of a multilayer file as (height, width, 3), the top row first."""
    exr = importlib.import_module(f"{PACKAGE}.exr")
    return exr.read(path, [f"ViewLayer.{name}.{component}" for component in "RGB"])


def saved_picture(path):
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    return pixels[::-1]


def error_of(picture, reference):
    """relL2 with the reference's brightness below."""
    below = reference.mean(-1, keepdims=True) ** 2 + 0.01
    return float((((picture - reference) ** 2) / below).mean())


class Correct(unittest.TestCase):
    def setUp(self):
        self.scene = scene_with_texture()

    def correct(self, **arguments):
        """Runs the operator; the message of a failure."""
        before = settings_of(self.scene)
        try:
            result = bpy.ops.sspc.correct(**arguments)
            self.assertEqual(result, {"FINISHED"})
            failure = None
        except RuntimeError as error:
            failure = str(error)
            self.assertEqual(state().level, "ERROR")
        self.assertEqual(settings_of(self.scene), before)
        self.assertFalse(state().running)
        return failure

    def test_a_frame(self):
        self.assertIsNone(self.correct())
        folder = Path(self.scene.sspc.folder)
        kept = ["a.0002.exr", "b.0002.exr", "corrected-passes.0002.exr", "corrected.0002.exr", "fit"]
        self.assertEqual(files(folder), kept)
        self.assertIn("model.onnx", files(folder / "fit"))
        picture = saved_picture(folder / "corrected.0002.exr")
        self.assertEqual(picture.shape, (HEIGHT, WIDTH, 4))
        np.testing.assert_array_equal(picture[..., :3], passes(folder / "corrected-passes.0002.exr", "Combined"))
        self.assertTrue((picture[..., 3] == 1).all())
        shown = bpy.data.images["sspc corrected"]
        np.testing.assert_array_equal(np.array(shown.pixels[:]).reshape(HEIGHT, WIDTH, 4)[::-1], picture)
        self.assertTrue(shown.use_view_as_render)
        self.assertEqual((state().level, state().message.split(",")[0]), ("INFO", f"Corrected the frame in {folder}"))

        # The halves are what they should be: other noise, half of the samples, both denoised.
        halves = {
            half: {name: passes(folder / f"{half}.0002.exr", name) for name in ("Noisy Image", "Combined")}
            for half in "ab"
        }
        noisy, denoised = ({half: halves[half][name] for half in "ab"} for name in ("Noisy Image", "Combined"))
        self.assertGreater(np.abs(noisy["a"] - noisy["b"]).mean(), 2 * np.abs(denoised["a"] - denoised["b"]).mean())
        # And the picture is better than both together denoised.
        self.scene.cycles.samples, self.scene.cycles.seed = 64 * 64, 99
        image = self.scene.render.image_settings
        if hasattr(image, "media_type"):
            image.media_type = "MULTI_LAYER_IMAGE"
        image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
        self.scene.render.filepath = str(folder / "reference.exr")
        self.scene.frame_set(2)
        bpy.ops.render.render(write_still=True)
        reference = passes(folder / "reference.exr", "Combined")
        before = error_of((denoised["a"] + denoised["b"]) / 2, reference)
        after = error_of(picture[..., :3], reference)
        print(f"relL2: denoised {before:.5f}, corrected {after:.5f}")
        self.assertLess(after, before)

    def test_an_animation(self):
        self.scene.sspc.keep, self.scene.sspc.fit_frames = False, 2
        self.scene.frame_step = 2
        self.assertIsNone(self.correct(animation=True))
        self.assertEqual(files(self.scene.sspc.folder), ["corrected.0001.exr", "corrected.0003.exr"])
        self.assertIn("Corrected 2 frames", state().message)

    def test_the_picture_need_not_be_saved(self):
        self.scene.sspc.keep = self.scene.sspc.save = False
        self.scene.sspc.folder = "//corrected/"
        self.assertIsNone(self.correct())
        self.assertEqual(tuple(bpy.data.images["sspc corrected"].size), (WIDTH, HEIGHT))
        self.scene.sspc.save = True
        self.assertIn("never saved", self.correct())

    def test_a_transparent_film_keeps_its_alpha(self):
        self.scene.render.film_transparent = True
        bpy.data.objects["Plane"].scale = (0.2, 0.2, 1)
        self.assertIsNone(self.correct())
        alpha = saved_picture(Path(self.scene.sspc.folder, "corrected.0002.exr"))[..., 3]
        self.assertEqual((alpha.min(), alpha.max()), (0, 1))

    def test_a_driven_seed_is_not_the_same_in_both_halves(self):
        driver = self.scene.driver_add("cycles.seed").driver
        driver.expression = "frame"
        self.scene.frame_set(2, subframe=0.25)
        self.assertIsNone(self.correct())
        folder = Path(self.scene.sspc.folder)
        a, b = (passes(folder / f"{half}.0002.exr", "Noisy Image") for half in "ab")
        self.assertFalse((a == b).all())

    def test_a_keyframed_seed_is_refused(self):
        self.scene.keyframe_insert("cycles.seed", frame=1)
        self.assertIn("seed is animated", self.correct())

    def test_failures_leave_everything_as_it_was(self):
        self.scene.camera = None
        self.assertIn("camera", self.correct().lower())
        self.scene.camera = bpy.data.objects["camera"]
        broken = Path(self.scene.sspc.folder, "programs")
        broken.mkdir()
        preferences = bpy.context.preferences.addons[PACKAGE].preferences
        preferences.programs = str(broken)
        try:
            self.assertIn("sspc-train was not found", self.correct())
            for name in ("sspc-train", "sspc-infer"):
                (broken / name).write_text("#!/bin/sh\necho openjd_fail: no luck\nexit 4\n")
            self.assertIn("sspc-train: no luck", self.correct())
        finally:
            preferences.programs = ""
        self.assertEqual(files(self.scene.sspc.folder), ["programs"])
        self.scene.render.use_multiview = True
        self.assertIn("Stereoscopy is on", self.correct())
        self.scene.render.use_multiview = False
        self.scene.sspc.folder = str(broken / "sspc-train")
        self.assertIn("Cannot make the folder", self.correct())

    def test_another_engine_is_not_offered(self):
        self.scene.render.engine = "BLENDER_WORKBENCH"
        self.assertFalse(bpy.ops.sspc.correct.poll())

    def test_geometry_that_differs_between_halves_is_told(self):
        ball = bpy.data.objects["Sphere.001"]
        renders = []

        def move(*_):
            renders.append(None)
            ball.location.z = 0.7 + 0.5 * len(renders)

        bpy.app.handlers.render_pre.append(move)
        try:
            self.assertIsNone(self.correct())
        finally:
            bpy.app.handlers.render_pre.remove(move)
        self.assertEqual(state().level, "WARNING")
        self.assertIn("halves", state().message)

    def test_the_panel_and_the_status_bar_use_what_there_is(self):
        panel = importlib.import_module(f"{PACKAGE}.panel")
        for running in (False, True):
            state().running, state().message = running, "a message of many words " * 8
            drawn = Layout()
            panel.SSPC_PT_output.draw(type("Panel", (), {"layout": drawn})(), bpy.context)
            self.assertEqual("progress" in drawn.calls, running)
            self.assertEqual("sspc.correct" in drawn.calls, not running)
        panel.draw_status(type("Header", (), {"layout": drawn})(), bpy.context)
        state().running, state().message = False, ""


class Layout:
    """Takes what a panel draws, and checks that properties and operators exist."""

    def __init__(self):
        self.calls = []

    def prop(self, owner, name):
        getattr(owner, name)

    def operator(self, name, **_):
        self.calls.append(name)
        area, function = name.split(".")
        getattr(getattr(bpy.ops, area), function).get_rna_type()
        return type("Properties", (), {})()

    def __getattr__(self, name):
        if name not in bpy.types.UILayout.bl_rna.functions:
            raise AttributeError(name)
        return lambda **_: self.calls.append(name) or self


class Register(unittest.TestCase):
    def test_nothing_stays_behind(self):
        everything = self.everything()
        self.assertIn("SSPC_OT_correct", everything)
        bpy.ops.preferences.addon_disable(module=PACKAGE)
        without = self.everything()
        self.assertEqual([name for name in without if "sspc" in str(name).lower()], [])
        bpy.ops.preferences.addon_enable(module=PACKAGE)
        self.assertEqual(self.everything(), everything)
        bpy.ops.preferences.addon_disable(module=PACKAGE)
        self.assertEqual(self.everything(), without)
        bpy.ops.preferences.addon_enable(module=PACKAGE)

    def everything(self):
        found = set(dir(bpy.types)) | {
            f"op {name}" for area in ("sspc", "render") for name in dir(getattr(bpy.ops, area))
        }
        for owner in (bpy.types.Scene, bpy.types.WindowManager):
            found |= {f"{owner.__name__}.{setting.identifier}" for setting in owner.bl_rna.properties}
        for name in dir(bpy.app.handlers):
            listed = getattr(bpy.app.handlers, name)
            if isinstance(listed, list):
                found |= {(name, str(handler)) for handler in listed}
        return found


if __name__ == "__main__":
    unittest.main()
