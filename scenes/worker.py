"""A renderer in a process of its own: Mitsuba and Blender do not share one well, and a process can be ended at any moment."""

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
    """A context in which one scene can be rendered again and again; leaving it ends the process."""

    def __init__(self, renderer, *scene):
        """`renderer` is "mitsuba" or "cycles", `scene` what its Renderer is made of: name, size, depth, threads."""
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        # The process may be killed at any moment: what it left here goes with the folder.
        self.scratch = tempfile.TemporaryDirectory(prefix="scenes-")
        self.process = context.Process(target=serve, args=(theirs, self.scratch.name, renderer, scene), daemon=True)
        # Ctrl-C reaches all processes of a terminal; this one's end is its parent's business from its first moment on.
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
    # Blender tells standard output about every pass and file; errors go to the other one.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    try:
        made = importlib.import_module(f"scenes.{renderer}_renderer").Renderer(*scene)
        while True:
            pipe.send((made.render(*pipe.recv()), None))
    except EOFError:
        return
    except Exception:
        pipe.send((None, traceback.format_exc()))
