"""Tests of the Blender extension: `python3 -m unittest integrations/blender/test_blender.py`.

Those inside Blender need an interpreter with bpy (`pip install bpy`), this one or those that SSPC_BLENDER_PYTHON names,
separated as in PATH; those of the interface a Blender that can open a window, which SSPC_BLENDER names.
"""

import importlib.util
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import OpenEXR

from integrations import testing

HERE = Path(__file__).parent
SAMPLES = [testing.SAMPLE / "a.exr", testing.SAMPLE / "ref.exr", testing.SAMPLE.with_name("blender") / "a.exr"]


def loaded(name):
    """A module of the extension, without the package, which needs Blender."""
    spec = importlib.util.spec_from_file_location(name, HERE / "sspc_correct" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def interpreters():
    """Those that have bpy."""
    named = os.environ.get("SSPC_BLENDER_PYTHON")
    if named:
        return named.split(os.pathsep)
    return [sys.executable] if importlib.util.find_spec("bpy") else []


class Reader(unittest.TestCase):
    def test_every_channel_is_what_openexr_reads(self):
        exr = loaded("exr")
        for path in SAMPLES:
            for part in OpenEXR.File(str(path), separate_channels=True).parts:
                for name, channel in part.channels.items():
                    found = exr.read(path, [name])[..., 0]
                    np.testing.assert_array_equal(found, channel.pixels.astype(np.float32), f"{path} {name}")

    def test_what_is_written_is_what_was_given(self):
        exr, random = loaded("exr"), np.random.default_rng(1)
        with tempfile.TemporaryDirectory() as folder:
            for height, width in ((1, 1), (16, 5), (35, 7)):
                path = Path(folder, f"{height}.exr")
                picture = random.normal(size=(height, width, 4)).astype(np.float32)
                picture[: height // 2] = 0.5
                exr.write(path, picture)
                np.testing.assert_array_equal(OpenEXR.File(str(path)).channels()["RGBA"].pixels, picture)
                np.testing.assert_array_equal(exr.read(path, "RGBA"), picture)

    def test_bad_files_are_refused(self):
        exr = loaded("exr")
        good = SAMPLES[0].read_bytes()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "bad.exr")
            for bad in (b"", good[:100], good[: len(good) // 2], b"\x00" + good[1:]):
                path.write_bytes(bad)
                with self.assertRaises(exr.Unreadable):
                    exr.read(path, ["R"])
        with self.assertRaises(exr.Missing):
            exr.read(SAMPLES[0], ["no such channel"])


class Blender(unittest.TestCase):
    def test_inside_blender(self):
        found = interpreters()
        if not found:
            testing.skip(self, "no bpy; `pip install bpy`, or let SSPC_BLENDER_PYTHON name an interpreter that has it")
        for python in found:
            with self.subTest(python=python), tempfile.TemporaryDirectory() as folder:
                self.run_inside([python, "-m", "unittest", "-v", "integrations/blender/in_blender.py"], Path(folder))

    def test_beside_the_interface(self):
        blender = os.environ.get("SSPC_BLENDER")
        if not blender:
            testing.skip(self, "SSPC_BLENDER names no Blender that can open a window")
        with tempfile.TemporaryDirectory() as folder:
            script = HERE / "in_interface.py"
            said = self.run_inside([blender, "--factory-startup", "--python", script], Path(folder))
            self.assertIn("in_interface: all as expected", said)

    def run_inside(self, command, folder):
        """Runs Blender with folders of its own; what it said."""
        resources, scratch = folder / "resources", folder / "scratch"
        resources.mkdir()
        scratch.mkdir()
        own = {"BLENDER_USER_RESOURCES": str(resources), "SSPC_SCRATCH": str(scratch)}
        done = subprocess.run(
            command,
            cwd=testing.ROOT,
            env=testing.environment(**own),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        self.assertEqual(done.returncode, 0, done.stdout[-20000:])
        return done.stdout


if __name__ == "__main__":
    unittest.main()
