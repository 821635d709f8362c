"""Tests of the scenes' writer, textures and meshes: `python3 -m unittest discover -s scenes -t .`. Renders nothing."""

import contextlib
import io
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
import OpenEXR

from bench import frames
from scenes import catalogue, command, frame, shapes, shots, textures, worker

# Half floats keep 11 bits: values are rounded by half a unit in the last of them.
HALF_ROUNDING = 2.0**-11


def buffers(seed, height=16, width=16):
    random = np.random.default_rng(seed)
    sizes = {"color": 3, "albedo": 3, "normal": 3, "visibility": 1}
    return {role: random.uniform(0, 1, (height, width, channels)) for role, channels in sizes.items()}


class InAFolder(unittest.TestCase):
    """What is written into a folder of the test's own."""

    def setUp(self):
        holder = tempfile.TemporaryDirectory()
        self.addCleanup(holder.cleanup)
        self.root = Path(holder.name)
        # OIDN is no part of the tests' environment; what is written does not depend on it.
        patch = mock.patch.object(frame, "denoised", lambda given: 0.5 * given["color"])
        patch.start()
        self.addCleanup(patch.stop)

    def read(self, name):
        file = OpenEXR.File(str(self.root / name), separate_channels=True)
        return {name: channel.pixels for name, channel in file.channels().items()}


class Writing(InAFolder):
    def test_a_frame_comes_back_as_it_was_to_half_a_float(self):
        a, b = buffers(1, 17, 23), buffers(2, 17, 23)
        a["color"][3, 5, 0] = 1e9
        frame.write_frame(self.root / "s", 16, a, b)
        found = self.read("s/16spp.a.exr")
        self.assertEqual({"albedo.G", "normal.Z", "visibility.Y", "denoised.B", "R"} - set(found), set())
        self.assertEqual(found["R"].dtype, np.float16)
        self.assertEqual(
            found["R"][3, 5], np.float16(frame.HALF_MAX), "what no half float holds is the largest one, not infinite"
        )
        for index, name in enumerate(("normal.X", "normal.Y", "normal.Z")):
            np.testing.assert_allclose(found[name], a["normal"][..., index], rtol=HALF_ROUNDING, atol=1e-7)
        whole = self.read("s/16spp.denoised.exr")["G"]
        np.testing.assert_allclose(whole, 0.25 * (a["color"] + b["color"])[..., 1], rtol=HALF_ROUNDING)

    def test_the_bench_finds_what_is_written(self):
        without = {role: planes for role, planes in buffers(3).items() if role != "visibility"}
        frame.write_frame(self.root / "any-name", 64, without, without)
        frame.write_reference(self.root / "any-name", without["color"], 3 * without["color"])
        (found,) = frames.find(self.root)
        self.assertEqual((found.name, found.spp, found.reference.name), ("any-name/64spp", 64, "ref.exr"))
        self.assertEqual(found.denoised.name, "64spp.denoised.exr")
        reference = self.read("any-name/ref.exr")
        np.testing.assert_allclose(reference["R"], 2 * reference["a.R"].astype(float), rtol=2 * HALF_ROUNDING)
        self.assertNotIn("visibility.Y", self.read("any-name/64spp.a.exr"))

    def test_a_write_that_fails_leaves_nothing_and_keeps_what_was_there(self):
        frame.write(self.root / "x.exr", {"color": np.ones((4, 4, 3))})
        with (
            mock.patch.object(OpenEXR.File, "write", side_effect=RuntimeError("disk full")),
            self.assertRaises(RuntimeError),
        ):
            frame.write(self.root / "x.exr", {"color": np.zeros((4, 4, 3))})
        self.assertEqual([path.name for path in self.root.iterdir()], ["x.exr"])
        self.assertEqual(self.read("x.exr")["R"].min(), 1)


class Shots(InAFolder):
    """Frames of a shot as they are written, by a worker that gives noise."""

    def written(self):
        rendered = []

        class Noise:
            def render(self, spp, seed):
                rendered.append((spp, seed))
                motion, camera = np.full((16, 16, 4), 1234.56), np.arange(16.0).reshape(4, 4)
                return buffers(len(rendered)) | {"motion": motion, "camera": camera}

        shot = shots.Shot("none", 1, 160, 256, "")
        shots.write_frame(self.root / "s", shot, "s", 3, Noise())
        return rendered

    def test_motion_and_camera_are_kept_whole(self):
        self.written()
        self.assertEqual(self.read("s/a.1003.exr")["Vector.W"][0, 0], np.float32(1234.56))
        header = OpenEXR.File(str(self.root / "s/b.1003.exr")).header()
        np.testing.assert_array_equal(header["worldToNDC"], np.arange(16.0).reshape(4, 4))
        self.assertEqual({"a.R", "b.B", "G"} - set(self.read("s/ref.1003.exr")), set())

    def test_every_part_of_a_half_has_a_seed_of_its_own(self):
        rendered = self.written()
        # Halves of 80 samples in two parts, references of 128 in two.
        self.assertEqual([spp for spp, _ in rendered], [64, 16, 64, 16, 64, 64, 64, 64])
        self.assertEqual(len({seed for _, seed in rendered}), len(rendered))


class Rendering(unittest.TestCase):
    """The command with a renderer that counts instead of rendering."""

    def test_what_is_there_is_not_rendered_again(self):
        calls = []

        def half(_, scene, label, spp, *key):
            calls.append((scene.name, spp, *key))
            return buffers(len(calls))

        with (
            tempfile.TemporaryDirectory() as root,
            mock.patch.object(command, "render_half", half),
            mock.patch.object(
                command, "render_reference", lambda *given: calls.append(given[1:3]) or np.zeros((2, 16, 16, 3))
            ),
            mock.patch.object(command, "Worker", mock.MagicMock()),
            mock.patch.object(frame, "denoised", lambda given: given["color"]),
            contextlib.redirect_stdout(io.StringIO()) as said,
        ):
            arguments = [root, "--scene", "leaves", "--spp", "4,16"]
            self.assertEqual(command.main([*arguments, "--reference-spp", "0"]), 0)
            self.assertEqual(calls, [("leaves", spp // 2, spp, half) for spp in (4, 16) for half in "ab"])
            self.assertEqual(command.main([*arguments, "--reference-spp", "32"]), 0)
            self.assertEqual(calls[4:], [(catalogue.SCENES["leaves"], 16)])
            self.assertEqual(command.main(arguments), 0)
            self.assertEqual(len(calls), 5)
            self.assertIn("leaves: complete", said.getvalue())

    def test_an_interrupted_reference_goes_on_where_it_was(self):
        """Also checks that its samples weigh the same whatever pass they came in: 40 samples are 16, 16 and 8."""
        scene, seeds = catalogue.SCENES["leaves"], []

        def failing(fails_at):
            def render(samples, seed):
                seeds.append(seed)
                if len(seeds) == fails_at:
                    raise KeyboardInterrupt
                return {"color": np.random.default_rng(seed).uniform(0, 1, (4, 6, 3)) / samples}

            return mock.Mock(render=render)

        with tempfile.TemporaryDirectory() as root, contextlib.redirect_stdout(io.StringIO()):
            whole = command.render_reference(failing(None), scene, 40, Path(root) / "whole", (6, 4))
            all_seeds = seeds.copy()
            seeds.clear()
            with self.assertRaises(KeyboardInterrupt):
                command.render_reference(failing(4), scene, 40, Path(root) / "cut", (6, 4))
            seeds.clear()
            cut = command.render_reference(failing(None), scene, 40, Path(root) / "cut", (6, 4))
        self.assertEqual(seeds, all_seeds[2:], "the first pass of both halves was kept, the half-finished one not")
        np.testing.assert_array_equal(cut, whole)
        values = [np.random.default_rng(seed).uniform(0, 1, (4, 6, 3)) for seed in all_seeds[::2]]
        np.testing.assert_allclose(cut[0], sum(values) / 40)

    def test_seeds_differ_between_all_passes_of_all_scenes(self):
        keys = [
            (name, kind, half, done)
            for name in catalogue.SCENES
            for kind in (4, 16, 64, 256, "reference")
            for half in "ab"
            for done in range(0, 512, 16)
        ]
        self.assertEqual(len({command.seed_of(*key) for key in keys}), len(keys))


class Workers(unittest.TestCase):
    def test_a_renderer_that_cannot_start_is_an_error_with_its_reason(self):
        with (
            worker.Worker("no_such", "leaves", (4, 4), 2, 1) as started,
            self.assertRaisesRegex(worker.Failed, "no_such_renderer"),
        ):
            started.render(1, 1)
        self.assertFalse(started.process.is_alive())
        self.assertFalse(Path(started.scratch.name).exists())


class Descriptions(unittest.TestCase):
    def test_textures_are_reflectances_and_the_same_every_time(self):
        for make in (
            textures.bricks,
            textures.planks,
            textures.weave,
            textures.checker,
            textures.wallpaper,
            textures.ground,
            textures.speckle,
        ):
            texture = make(64)
            self.assertEqual(texture.shape, (64, 64, 3), make.__name__)
            self.assertTrue(np.all(texture >= 0) and np.all(texture <= 1), make.__name__)
            np.testing.assert_array_equal(texture, make(64), make.__name__)

    def test_meshes_are_closed_in_their_numbers(self):
        for mesh in (shapes.foliage(3, 5, seed=1), shapes.torus((0, 0, 0), 1, 0.2, 8, 6)):
            self.assertEqual(len(mesh.positions), len(mesh.uv))
            self.assertLess(mesh.triangles.max(), len(mesh.positions))
            self.assertTrue(np.all(np.isfinite(mesh.positions)))

    def test_the_ring_faces_outwards(self):
        ring = shapes.torus((0, 0, 0), 1, 0.2, 24, 12)
        a, b, c = (ring.positions[ring.triangles[:, corner]] for corner in range(3))
        middle = (a + b + c) / 3
        core = middle * (1, 0, 1)
        core /= np.linalg.norm(core, axis=1, keepdims=True)
        outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), middle - core)
        self.assertTrue(np.all(outwards > 0))


if __name__ == "__main__":
    unittest.main()
