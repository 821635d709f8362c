"""The job template as openjd-cli checks and runs it: `python3 -m unittest integrations/openjd/test_openjd.py`.

SSPC_OPENJD names the program `openjd` where it is neither beside this interpreter nor on the PATH.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from integrations import testing

TEMPLATE = Path(__file__).with_name("sspc.yaml")
FRAMES = range(1, 6)
BAD = 3


def openjd():
    """Path of openjd-cli's program, or None."""
    beside = Path(sys.executable).with_name("openjd")
    return os.environ.get("SSPC_OPENJD") or (beside if beside.is_file() else shutil.which("openjd"))


class Template(unittest.TestCase):
    def setUp(self):
        self.openjd = openjd()
        if not self.openjd:
            testing.skip(self, "no openjd; `pip install openjd-cli`, or let SSPC_OPENJD name it")
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        # Blanks and signs that a shell would read.
        self.shot = Path(scratch.name, "a shot of $HOME & 'me'")
        self.shot.mkdir()
        self.out = Path(scratch.name, "not yet", "out")

    def run_job(self, step, *arguments, frames_per_task=2):
        """The exit status and everything that was said."""
        parameters = {"Shot": self.shot, "Output": self.out, "FitFrames": "1,5", "Frames": "1-5"}
        parameters |= {"Preset": "fast", "FitOptions": "--steps 5 --threads 2", "FramesPerTask": frames_per_task}
        given = [word for key, value in parameters.items() for word in ("-p", f"{key}={value}")]
        command = [self.openjd, "run", TEMPLATE, "--step", step, *given, *arguments]
        done = subprocess.run(command, env=testing.environment(), capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr

    def pictures(self):
        return {path.name: path.read_bytes() for path in self.out.glob("corrected.*.exr")}

    def test_the_template_is_valid(self):
        done = subprocess.run([self.openjd, "check", TEMPLATE], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_a_shot_with_a_bad_frame(self):
        testing.write_shot(self.shot, FRAMES)
        bad = self.shot / f"a.{BAD:04}.exr"
        good = bad.read_bytes()
        bad.write_bytes(good[:1000])

        code, said = self.run_job("Correct", "--run-dependencies")
        self.assertNotEqual(code, 0, said)
        self.assertIn("openjd_status: training step 5/5", said)
        self.assertIn("openjd_fail: 1 of 2 frames failed (frame 3); the others are complete", said)
        self.assertTrue((self.out / "fit" / "model.onnx").is_file(), said)
        # The task of the bad frame has done its other frame; the session ends there.
        self.assertEqual(sorted(self.pictures()), [f"corrected.{frame:04}.exr" for frame in (1, 2, 4)])

        # What a farm does with tasks that failed or did not run; and with that of frame 2, which had no neighbour.
        bad.write_bytes(good)
        code, said = self.run_job("Correct", "--tasks", '[{"Frames": "1-2"}, {"Frames": "3-4"}, {"Frames": "5"}]')
        self.assertEqual(code, 0, said)
        self.assertIn("openjd_progress: 100.0", said)
        in_chunks = self.pictures()
        self.assertEqual(len(in_chunks), len(FRAMES))

        # The same pictures from one task.
        for name in in_chunks:
            (self.out / name).unlink()
        code, said = self.run_job("Correct", frames_per_task=5)
        self.assertEqual(code, 0, said)
        self.assertTrue(self.pictures() == in_chunks, "other bytes in one task")

    def test_a_failing_fit_ends_the_job(self):
        code, said = self.run_job("Correct", "--run-dependencies")
        self.assertNotEqual(code, 0, said)
        self.assertIn("openjd_fail: a.0001.exr", said)
        self.assertEqual(self.pictures(), {})


if __name__ == "__main__":
    unittest.main()
