"""A headless Chromium, spoken to over its debugging pipe: opens a file, evaluates, presses keys, moves the mouse.

Needs no package: the protocol (https://chromedevtools.github.io/devtools-protocol/) is JSON, a NUL after each message.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time

NAMES = ("chromium", "chromium-headless-shell", "chromium-browser", "google-chrome", "chrome")
# Longest wait for one answer, seconds.
PATIENCE = 60


def find():
    """Path of a browser, or None; SSPC_CHROMIUM names one."""
    return os.environ.get("SSPC_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """A context with one tab."""

    def __init__(self, program, width=1600, height=1500):
        self.folder = tempfile.TemporaryDirectory(prefix="sspc-browser-")
        theirs_in, self.write_end = os.pipe()
        self.read_end, theirs_out = os.pipe()
        # The browser reads its descriptor 3 and writes 4.
        command = f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}'
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--hide-scrollbars"]
        options += [f"--user-data-dir={self.folder.name}", f"--window-size={width},{height}", "about:blank"]
        self.process = subprocess.Popen(
            ["bash", "-c", command, program, *options], pass_fds=(theirs_in, theirs_out), stderr=subprocess.DEVNULL
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self.buffer, self.number, self.events, self.session = b"", 0, [], None
        target = next(t for t in self.ask("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.ask("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        os.close(self.write_end)
        os.close(self.read_end)
        # Its children may still be writing.
        shutil.rmtree(self.folder.name, ignore_errors=True)

    def ask(self, method, **parameters):
        """The answer to a command; events that come before it are kept."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write_end, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.next_message()
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self.events.append(answer)

    def next_message(self):
        until = time.monotonic() + PATIENCE
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.read_end], [], [], max(until - time.monotonic(), 0))
            part = os.read(self.read_end, 1 << 20) if ready else b""
            if not part:
                raise RuntimeError("the browser does not answer")
            self.buffer += part
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def open(self, path):
        """Opens a file and waits until it is loaded."""
        self.events.clear()
        self.ask("Page.navigate", url=path.resolve().as_uri())
        until = time.monotonic() + PATIENCE
        while not self.value("document.readyState === 'complete' && location.protocol === 'file:'"):
            if time.monotonic() > until:
                raise RuntimeError(f"{path} does not load")
            time.sleep(0.05)
        # Pictures inside the page are decoded after it is loaded.
        self.value("Promise.all([...document.images].map((image) => image.decode())).then(() => true)")

    def value(self, expression):
        """What a JavaScript expression, or its promise, comes to."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def settle(self):
        """Waits until what was asked for is drawn, transitions of the slider included."""
        self.value("new Promise((done) => setTimeout(() => requestAnimationFrame(() => done(true)), 250))")

    def press(self, key, code="", shift=False):
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=code, modifiers=8 if shift else 0)
        self.settle()

    def mouse(self, kind, x, y, **more):
        self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start, end):
        held = {"button": "left", "buttons": 1}
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, clickCount=1, **held)
        for part in (0.5, 1):
            self.mouse("mouseMoved", *(s + part * (e - s) for s, e in zip(start, end)), **held)
        self.mouse("mouseReleased", *end, clickCount=1, **held)
        self.settle()

    def screenshot(self, element=None):
        """The window, or what of it an element (an expression) covers, as PNG."""
        area = {}
        if element:
            box = f"(({{x, y, width, height}}) => ({{x, y, width, height}}))({element}.getBoundingClientRect())"
            area = {"clip": self.value(box) | {"scale": 1}}
        return base64.b64decode(self.ask("Page.captureScreenshot", format="png", **area)["data"])

    def faults(self):
        """Exceptions, errors on the console and requests for anything but the page itself and data."""
        found = []
        for event in self.events:
            method, what = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(str(what["exceptionDetails"]))
            elif method == "Log.entryAdded" and what["entry"]["level"] in ("error", "warning"):
                found.append(what["entry"]["text"])
            elif method == "Network.requestWillBeSent" and not what["request"]["url"].startswith(("file:", "data:")):
                found.append(what["request"]["url"])
        return found
