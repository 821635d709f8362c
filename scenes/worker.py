"""A renderer in its own process: Mitsuba and Blender conflict in one, and a process can be ended at any time."""

import importlib
import multiprocessing
import os
import signal
import sys
import tempfile
import traceback


class Failed(Exception):
    """The renderer raised an error, or its process ended."""


class Worker:
    """A context that renders one scene repeatedly; leaving it ends the process."""

    def __init__(self, renderer, *scene):
        """`renderer` is "mitsuba" or "cycles", `scene` its Renderer's arguments: name, size, depth, threads."""
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        # The process may be killed at any time; its files are removed with this folder.
        self.scratch = tempfile.TemporaryDirectory(prefix="scenes-")
        self.process = context.Process(target=serve, args=(theirs, self.scratch.name, renderer, scene), daemon=True)
        # Ctrl-C reaches all processes of a terminal, but the parent decides when this one ends.
        usual = signal.signal(signal.SIGINT, signal.SIG_IGN)
        self.process.start()
        signal.signal(signal.SIGINT, usual)
        theirs.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.join()
        self.scratch.cleanup()

    def render(self, spp, seed):
        """Buffers of (height, width, channels) by role."""
        try:
            self.pipe.send((spp, seed))
            buffers, error = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            raise Failed(f"the renderer's process ended with code {self.process.exitcode}") from None
        if error:
            raise Failed(error)
        return buffers


def serve(pipe, scratch, renderer, scene):
    """The process: builds the scene and answers until the pipe is closed."""
    tempfile.tempdir = scratch
    # Blender reports every pass and file on standard output; errors go to standard error.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    try:
        made = importlib.import_module(f"scenes.{renderer}_renderer").Renderer(*scene)
        while True:
            pipe.send((made.render(*pipe.recv()), None))
    except EOFError:
        return
    except Exception:
        pipe.send((None, traceback.format_exc()))
