"""The programs sspc-train and sspc-infer: where they are, and one of them at work."""

import os
import shutil
import subprocess
import threading
from pathlib import Path

# Seconds in which a program that is asked to stop has to be gone; it removes what it began.
PATIENCE = 10
# Lines of a failed program that are shown.
LAST_LINES = 4


class NotFound(Exception):
    """A program is nowhere; says where it was looked for."""


class ProgramFailed(Exception):
    """A program ended with an error; says what it said."""


def find(name, named_folder):
    """Path of a program: in the folder of the preferences, else in this extension, else on the PATH."""
    file = f"{name}.exe" if os.name == "nt" else name
    bundled = Path(__file__).with_name("bin")
    folders = [Path(named_folder)] if named_folder else [bundled]
    for folder in folders:
        path = folder / file
        if path.is_file():
            if os.name != "nt" and not os.access(path, os.X_OK):
                # Archives may lose the permission to run.
                path.chmod(path.stat().st_mode | 0o111)
            return str(path)
    found = None if named_folder else shutil.which(name)
    if not found:
        place = named_folder or f"neither in {bundled} nor on the PATH"
        raise NotFound(f"{name} was not found ({place}): name its folder in the extension's preferences")
    return found


class Program:
    """A program at work, with its progress and what it has said."""

    def __init__(self, command):
        self.fraction, self.status, self.failure, self.lines = 0.0, "", "", []
        flags = {"creationflags": subprocess.CREATE_NO_WINDOW} if os.name == "nt" else {}
        self.process = subprocess.Popen(
            [*command, "--progress", "openjd"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            **flags,
        )
        self.reader = threading.Thread(target=self.listen, daemon=True)
        self.reader.start()

    def listen(self):
        with self.process.stdout as said:
            for line in said:
                self.take(line)

    def take(self, line):
        kind, _, text = line.rstrip("\n").partition(": ")
        if kind == "openjd_progress":
            self.fraction = float(text) / 100
        elif kind == "openjd_status":
            self.status = text
        elif kind == "openjd_fail":
            self.failure = text
        else:
            self.lines.append(line.rstrip("\n"))

    def ended(self):
        """Whether it has done its work; an error where it failed."""
        if self.process.poll() is None:
            return False
        self.reader.join()
        if self.process.returncode != 0:
            said = self.failure or " / ".join(self.lines[-LAST_LINES:])
            raise ProgramFailed(f"{Path(self.process.args[0]).name}: {said}")
        return True

    def wait(self):
        self.process.wait()
        self.ended()

    def stop(self):
        """Ends it, gently first."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.reader.join()
