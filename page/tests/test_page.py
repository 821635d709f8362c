"""Opens report pages in a headless Chromium as a person would: slider, keys, wheel; skipped where there is none.

CARGO_TARGET_DIR=... python3 -m unittest page/tests/test_page.py      (SSPC_SCREENSHOTS=DIR keeps what was seen)
"""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from page.tests import browser

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "tests" / "data" / "sample"
PROGRAMS = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release"
CHROMIUM = browser.find()
# A page of one frame stays below this.
LARGEST = 5_000_000
# As a folder's name it would become an element, and run, where a page took text for markup.
HOSTILE = "<img src=x onerror=alert(1)>&amp;'\""

SHOWN = "[...document.querySelectorAll('#{}-layer img.shown')].map((image) => image.alt)[0]"
TRANSFORM = "document.getElementById('{}-layer').style.transform"


def run(program, *arguments):
    return subprocess.run([PROGRAMS / program, *arguments], capture_output=True, text=True)


def made_by(program, *arguments):
    done = run(program, *arguments)
    if done.returncode:
        raise AssertionError(f"{program} {arguments}: {done.stderr}")


@unittest.skipUnless(CHROMIUM, "no Chromium")
class Pages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="sspc-page-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.root = Path(cls.folder.name)
        halves = [SAMPLE / "a.exr", SAMPLE / "b.exr", "--denoised", SAMPLE / "denoised.exr"]
        cls.fit = cls.root / "fit"
        made_by(
            "sspc-train", "fit", *halves, "--reference", SAMPLE / "ref.exr", "--steps", "30", "--report", "-o", cls.fit
        )
        cls.browser = browser.Browser(CHROMIUM)
        cls.addClassCleanup(cls.browser.__exit__)

    def keep(self, name):
        """Keeps a screenshot where SSPC_SCREENSHOTS says."""
        if kept := os.environ.get("SSPC_SCREENSHOTS"):
            Path(kept).mkdir(parents=True, exist_ok=True)
            (Path(kept) / f"{name}.png").write_bytes(self.browser.screenshot())

    def shown(self, side):
        return self.browser.value(SHOWN.format(side))

    def slider(self):
        return self.browser.value("document.getElementById('slider').value")

    def sees_legend(self):
        return self.browser.value("document.getElementById('legend').offsetParent !== null")

    def middle(self):
        box = "(({left, top, width, height}) => [left, top, width, height])(slider.getBoundingClientRect())"
        left, top, width, height = self.browser.value(box)
        return left + width / 2, top + height / 2, width

    def test_a_fit(self):
        page = self.fit / "report.html"
        self.assertLess(page.stat().st_size, LARGEST)
        tab = self.browser
        tab.open(page)
        labels = tab.value("[...document.querySelectorAll('#first-layer img')].map((image) => image.alt)")
        expected = ["noisy", "denoised", "corrected", "reference", "error, denoised", "error, corrected", "share"]
        self.assertEqual(labels, expected)
        self.assertEqual((self.shown("first"), self.shown("second"), self.slider()), ("denoised", "corrected", 50))
        self.keep("fit-split")

        # Number keys flip in place: the same picture is the same to the pixel.
        tab.press("1", "Digit1")
        self.assertEqual((self.shown("first"), self.slider()), ("noisy", 100))
        tab.press("3", "Digit3")
        self.assertEqual(self.shown("first"), "corrected")
        self.keep("fit-corrected")
        corrected = tab.screenshot("slider")
        tab.press("1", "Digit1")
        self.assertEqual(self.shown("first"), "noisy")
        self.keep("fit-noisy")
        self.assertNotEqual(tab.screenshot("slider"), corrected)
        tab.press("3", "Digit3")
        self.assertTrue(tab.screenshot("slider") == corrected, "the picture moved")
        tab.press("9", "Digit9")
        self.assertEqual(self.shown("first"), "corrected")

        # Shift chooses the right picture and splits again; the legend tells what a map's colours mean.
        self.assertFalse(self.sees_legend())
        tab.press("^", "Digit6", shift=True)
        self.assertEqual((self.shown("second"), self.slider()), ("error, corrected", 50))
        self.assertTrue(self.sees_legend())
        self.keep("fit-error")
        tab.press("&", "Digit7", shift=True)
        self.keep("fit-share")
        tab.press(" ", "Space")
        self.assertEqual((self.slider(), self.sees_legend()), (100, False))
        tab.press(" ", "Space")
        self.assertEqual(self.slider(), 50)

        # The slider follows the mouse and the arrows.
        x, y, width = self.middle()
        tab.drag((x, y + 100), (x - width / 4, y + 100))
        self.assertAlmostEqual(self.slider(), 25, delta=1)
        before = self.slider()
        tab.press("ArrowRight", "ArrowRight")
        self.assertAlmostEqual(self.slider(), before + 1, places=3)
        self.keep("fit-slid")

        # Wheel and drag beside the line zoom and pan both pictures in step.
        fitted = tab.value(TRANSFORM.format("first"))
        tab.mouse("mouseWheel", x + 50, y + 50, deltaX=0, deltaY=-300)
        tab.settle()
        zoomed = tab.value(TRANSFORM.format("first"))
        tab.drag((x + 200, y), (x + 120, y + 40))
        panned = tab.value(TRANSFORM.format("first"))
        self.assertEqual(len({fitted, zoomed, panned}), 3, (fitted, zoomed, panned))
        self.assertEqual(tab.value(TRANSFORM.format("second")), panned)
        self.assertAlmostEqual(self.slider(), before + 1, places=3)
        self.keep("fit-zoomed")
        tab.press("0", "Digit0")
        self.assertEqual(tab.value(TRANSFORM.format("first")), fitted)
        tab.press("z", "KeyZ")
        self.assertEqual(tab.value("document.getElementById('zoom').textContent"), "100 %")

        # Exposure acts on pictures, not on maps.
        tab.press("0", "Digit0")
        tab.press("1", "Digit1")
        plain = tab.screenshot("slider")
        tab.press("+", "Equal", shift=True)
        self.assertEqual(tab.value("document.getElementById('stops').textContent"), "+0.5 stops")
        self.keep("fit-exposed")
        self.assertTrue(tab.screenshot("slider") != plain)
        filters = "getComputedStyle(document.querySelector('#first-layer img.{}')).filter"
        self.assertIn("exposure", tab.value(filters.format("radiance")))
        self.assertEqual(tab.value(filters.format("error")), "none")

        text = tab.value("document.body.innerText")
        for part in ("relL2 against the reference", "Roles", "Skipped", "Settings", "albedo.R", "Learning rate"):
            self.assertIn(part, text)
        self.assertEqual(tab.value("document.querySelectorAll('#curves canvas').length"), 2)
        tab.value("scrollTo(0, document.body.scrollHeight)")
        tab.settle()
        self.keep("fit-tables")
        self.assertEqual(tab.faults(), [])

    def test_a_shot_whose_names_are_hostile_and_of_which_a_frame_fails(self):
        shot = self.root / HOSTILE
        shot.mkdir()
        for number in (1001, 1002, 1003, 1004):
            for name in ("a", "b", "denoised", "ref"):
                if (number, name) != (1002, "b"):
                    shutil.copy(SAMPLE / f"{name}.exr", shot / f"{name}.{number}.exr")
        patterns = {"a": "a", "b": "b", "denoised": "denoised", "reference": "ref"}
        named = [part for key, name in patterns.items() for part in (f"--{key}", shot / f"{name}.####.exr")]
        model = ["--model", self.fit / "model.onnx", "--frames", "1001-1004"]
        done = run("sspc-infer", "run", *model, *named, "--report", "-o", shot / "out.####.exr")
        self.assertNotEqual(done.returncode, 0, "a frame has no half b")
        page = shot / "out.1001-1004.html"
        tab = self.browser
        tab.open(page)
        self.assertEqual(tab.value("document.querySelectorAll('#strip button').length"), 3)
        # Of three frames one follows another.
        self.assertEqual(tab.value("document.querySelectorAll('#strip .flicker').length"), 1)
        self.assertEqual(tab.value("document.querySelectorAll('[onerror]').length"), 0)
        self.assertIn(HOSTILE, tab.value("document.getElementById('title').textContent"))
        self.assertIn("frame 1002 was not corrected", tab.value("document.getElementById('messages').textContent"))
        self.keep("shot")
        tab.press("5", "Digit5")
        tab.press(".", "Period")
        current = tab.value(
            "[...document.querySelectorAll('#strip button')].findIndex((b) => b.ariaCurrent === 'true')"
        )
        self.assertEqual((current, self.shown("first")), (1, "error, denoised"))
        self.assertEqual(tab.faults(), [])


if not CHROMIUM:
    print("skipped: pages in a browser (no Chromium; SSPC_CHROMIUM names one)", file=sys.stderr)

if __name__ == "__main__":
    unittest.main()
