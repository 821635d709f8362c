"""Tests of the operator beside Blender's interface: `blender --factory-startup --python in_interface.py`.

test_blender.py runs it where SSPC_BLENDER names a Blender that can open a window. SSPC_SCRATCH names an empty folder;
SSPC_SCREENSHOTS, where it is set, one for pictures of the screen (by ImageMagick's `import`). Each step below waits for
the one before; the exit code tells whether all was as expected.
"""

import importlib
import os
import shutil
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from integrations.blender import in_blender  # noqa: E402

INTERVAL = 0.2
# Seconds after which a step has failed.
PATIENCE = 120


def steps():
    """Yields the condition to wait for."""
    yield lambda: True
    in_blender.setUpModule()
    scene = in_blender.scene_with_texture()
    do_without_denoiser()
    show_output_properties()
    yield lambda: True

    screenshot("ready")

    seen = set()
    before = in_blender.settings_of(scene)
    correct()
    assert state().running and not bpy.ops.sspc.correct.poll()
    yield lambda: note(seen) or not state().running
    assert state().message.startswith("Corrected the frame"), state().message
    assert any(text.startswith("Rendering half b") for text in seen) and any("step" in text for text in seen), seen
    restored(scene, before)
    assert "corrected.0002.exr" in in_blender.files(scene.sspc.folder)
    yield in_a_second()
    screenshot("done")

    # Cancelled while the second half is rendered: nothing is left, and the scene is as it was.
    scene.sspc.folder += "-cancelled"
    scene.cycles.samples = 2048
    before = in_blender.settings_of(scene)
    correct()
    yield lambda: state().text.startswith("Rendering")
    bpy.ops.sspc.cancel()
    yield lambda: not state().running
    assert state().message == "Cancelled", state().message
    restored(scene, before)
    assert in_blender.files(scene.sspc.folder) == []

    # Cancelled while the program fits.
    scene.cycles.samples, scene.sspc.preset = 8, "quality"
    before = in_blender.settings_of(scene)
    correct()
    yield lambda: "step" in state().text
    yield in_a_second()
    screenshot("fitting")
    bpy.ops.sspc.cancel()
    yield lambda: not state().running
    assert state().message == "Cancelled", state().message
    restored(scene, before)
    assert in_blender.files(scene.sspc.folder) == []

    # A program that fails ends it too.
    preferences = bpy.context.preferences.addons[in_blender.PACKAGE].preferences
    usual, preferences.programs = preferences.programs, str(broken_programs())
    correct()
    yield lambda: not state().running
    assert (state().level, state().message) == ("ERROR", "sspc-train: no luck"), state().message
    yield in_a_second()
    screenshot("failed")
    restored(scene, before)
    preferences.programs = usual

    # The extension goes while it is at work.
    correct()
    yield lambda: "step" in state().text
    bpy.ops.preferences.addon_disable(module=in_blender.PACKAGE)
    assert not hasattr(bpy.types.WindowManager, "sspc")
    yield lambda: True


def broken_programs():
    """A folder of programs that fail."""
    folder = in_blender.SCRATCH / "broken"
    folder.mkdir()
    for name in ("sspc-train", "sspc-infer"):
        (folder / name).write_text("#!/bin/sh\necho openjd_fail: no luck\nexit 4\n")
    return folder


def correct():
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        result = bpy.ops.sspc.correct("INVOKE_DEFAULT")
    assert result == {"RUNNING_MODAL"}, result


def in_a_second():
    """Time for Blender to draw."""
    until = time.monotonic() + 1
    return lambda: time.monotonic() > until


def state():
    return bpy.context.window_manager.sspc


def note(seen):
    """Remembers what the status bar says."""
    seen.add(state().text)


def restored(scene, before):
    after = in_blender.settings_of(scene)
    different = {key: (before[key], after[key]) for key in before if before[key] != after[key]}
    assert not different, different


def without_denoiser():
    import _cycles

    return not _cycles.with_openimagedenoise


def do_without_denoiser():
    """Some distributions build Blender without one: the noisy colour passes for denoised."""
    if without_denoiser():
        halves = importlib.import_module(f"{in_blender.PACKAGE}.halves")
        halves.has_denoiser = lambda: True
        borrow = halves.Borrowed.set
        halves.Borrowed.set = lambda self, owner, use_denoising=False, **values: borrow(self, owner, **values)
        programs = in_blender.SCRATCH / "programs"
        programs.mkdir()
        for name in ("sspc-train", "sspc-infer"):
            path = programs / name
            path.write_text(f'#!/bin/sh\nexec {shutil.which(name)} "$@" --role denoised=ViewLayer.Combined\n')
            path.chmod(0o755)
        bpy.context.preferences.addons[in_blender.PACKAGE].preferences.programs = str(programs)


def show_output_properties():
    """With our panel open; a tall window shows it below the others."""
    panel = bpy.types.SSPC_PT_output
    bpy.utils.unregister_class(panel)
    panel.bl_options = set()
    bpy.utils.register_class(panel)
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "PROPERTIES":
            area.spaces.active.context = "OUTPUT"


def screenshot(name):
    if folder := os.environ.get("SSPC_SCREENSHOTS"):
        subprocess.run(["import", "-window", "root", Path(folder, f"{name}.png")], check=True)


def run():
    """A timer that takes the steps."""
    script, condition, waited = steps(), None, 0.0

    def tick():
        nonlocal condition, waited
        try:
            if condition is None or condition():
                condition, waited = next(script), 0.0
            waited += INTERVAL
            assert waited < PATIENCE, f"nothing happens: {state().text}"
            return INTERVAL
        except StopIteration:
            print("in_interface: all as expected")
            sys.stdout.flush()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)

    bpy.app.timers.register(tick, persistent=True)


run()
