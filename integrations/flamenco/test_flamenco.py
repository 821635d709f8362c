"""The job type under node, with a stand-in of what Flamenco's manager gives to scripts; and its tasks, done for real.

    python3 -m unittest integrations/flamenco/test_flamenco.py

The latter needs Blender: SSPC_BLENDER_PYTHON names interpreters that have bpy, separated as in PATH.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from integrations import testing

HERE = Path(__file__).parent
SETTINGS = {
    "frames": "1-3, 7",
    "fit_frames": "1, 7",
    "chunk_size": 2,
    "render_output_root": "/shots",
    "render_output_path": "/shots/job/{timestamp}",
    "blendfile": "/shots/scene.blend",
    "engine": "CYCLES",
}
STAMP = "2026-01-02_030405"


def compiled(test, **settings):
    """The job's tasks by name, in their order, or the error that the script throws."""
    node = shutil.which("node")
    if not node:
        testing.skip(test, "no node")
    command = [node, HERE / "stand_in.js", HERE / "sspc_correct.js", json.dumps(SETTINGS | settings)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        return done.stderr.strip()
    return {task["name"]: task for task in json.loads(done.stdout)["tasks"]}


def parameters(task):
    (command,) = task["commands"]
    return command["parameters"]


class JobType(unittest.TestCase):
    def test_the_tasks_and_what_they_wait_for(self):
        tasks = compiled(self)
        waits = {name: sorted(task["dependencies"]) for name, task in tasks.items()}
        self.assertEqual(
            waits,
            {
                "render-a-1-2": [],
                "render-b-1-2": [],
                "render-a-3,7": [],
                "render-b-3,7": [],
                "fit": ["render-a-1-2", "render-a-3,7", "render-b-1-2", "render-b-3,7"],
                "correct-1-2": ["fit", "render-a-1-2", "render-b-1-2"],
                "correct-3,7": ["fit", "render-a-3,7", "render-b-3,7"],
            },
        )
        self.assertEqual({task["type"] for task in tasks.values()}, {"blender", "misc"})
        # A fit waits for the frames that it reads and no others.
        self.assertEqual(
            sorted(compiled(self, fit_frames="2")["fit"]["dependencies"]), ["render-a-1-2", "render-b-1-2"]
        )

    def test_the_command_lines(self):
        tasks, folder = compiled(self, sspc_train="/opt/sspc-train"), f"/shots/job/{STAMP}"
        halves = ["--a", f"{folder}/a.######.exr", "--b", f"{folder}/b.######.exr"]
        fit = {"exe": "/opt/sspc-train"}
        fit["args"] = ["fit", *halves, "--frames", "1,7", "--preset", "balanced", "-o", f"{folder}/fit"]
        self.assertEqual(parameters(tasks["fit"]), fit)
        correct = {"exe": "sspc-infer"}
        correct["args"] = ["run", "--model", f"{folder}/fit/model.onnx", *halves, "--frames", "3,7"]
        correct["args"] += ["-o", f"{folder}/corrected.######.exr"]
        self.assertEqual(parameters(tasks["correct-3,7"]), correct)
        render = parameters(tasks["render-b-1-2"])
        self.assertEqual((render["exe"], render["blendfile"]), ("{blender}", SETTINGS["blendfile"]))
        self.assertEqual(render["args"][2:], ["--render-output", f"{folder}/b.######", "--render-frame", "1..2"])
        seeds = [parameters(tasks[f"render-{half}-1-2"])["args"][1] for half in "ab"]
        self.assertNotEqual(*seeds)

    def test_what_makes_no_sense_is_refused(self):
        self.assertIn("frame 5 of fit_frames is not among", compiled(self, fit_frames="1,5"))
        self.assertIn("BLENDER_EEVEE", compiled(self, engine="BLENDER_EEVEE"))

    def test_the_tasks_done(self):
        named = os.environ.get("SSPC_BLENDER_PYTHON")
        here = [sys.executable] if importlib.util.find_spec("bpy") else []
        blenders = named.split(os.pathsep) if named else here
        if not blenders:
            testing.skip(self, "no bpy; let SSPC_BLENDER_PYTHON name an interpreter that has it")
        for blender in blenders:
            with self.subTest(blender=blender), tempfile.TemporaryDirectory() as folder:
                self.do(blender, Path(folder))

    def do(self, blender, folder):
        scene = folder / "scene.blend"
        self.run_command([blender, "-c", SCENE, scene])
        own = {"blendfile": str(scene), "render_output_path": str(folder / "out"), "preset": "fast"}
        for task in compiled(self, frames="1-3", fit_frames="1,3", **own).values():
            given = parameters(task)
            if task["type"] == "blender":
                _, expression, _, output, _, frames = given["args"]
                self.run_command([blender, "-c", RENDER, scene, expression, output, frames])
            else:
                self.run_command([given["exe"], *given["args"]])
        pictures = sorted(path.name for path in (folder / "out").glob("corrected.*.exr"))
        self.assertEqual(pictures, [f"corrected.{frame:06}.exr" for frame in (1, 2, 3)])

    def run_command(self, command):
        done = subprocess.run(
            command, env=testing.environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.assertEqual(done.returncode, 0, done.stdout[-4000:])


# A cube that is lit, in a file.
SCENE = """
import bpy, sys
bpy.ops.wm.read_factory_settings()
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.device, scene.cycles.samples = "CPU", 16
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 96, 64, 100
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""
# What Blender's own command line does with these arguments, which Blender as a module has not.
RENDER = """
import bpy, sys
file, expression, output, frames = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=file)
exec(expression)
scene = bpy.context.scene
scene.render.filepath = output
for part in frames.split(","):
    first, _, last = part.partition("..")
    for frame in range(int(first), int(last or first) + 1):
        scene.frame_start = scene.frame_end = frame
        bpy.ops.render.render(animation=True)
"""


if __name__ == "__main__":
    unittest.main()
