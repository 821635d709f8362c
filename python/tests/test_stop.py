"""Ctrl-C, callbacks that raise, threads, and processes."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import make_frame, same_bits

import sspc

# Far more than any test waits for; a step takes some milliseconds.
ENDLESS = 10**7
# Seconds in which a step and its end must have come, on a busy machine.
SOON = 10.0


class Enough(Exception):
    pass


def test_what_a_callback_raises_stops_the_fit_and_comes_through(frame):
    seen = []

    def progress(step):
        seen.append(step.step)
        if step.step == 3:
            raise Enough("three")

    with pytest.raises(Enough, match="three"):
        sspc.fit(**frame, steps=ENDLESS, progress=progress)
    assert seen == [1, 2, 3]


def test_a_callback_that_cannot_be_called(frame):
    with pytest.raises(TypeError):
        sspc.fit(**frame, steps=ENDLESS, progress=3)


def test_ctrl_c_ends_a_fit(frame):
    sent = []

    def interrupt():
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    # A process that a script starts in the background ignores it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer = threading.Timer(0.5, interrupt)
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            sspc.fit(**frame, steps=ENDLESS)
        assert time.monotonic() - sent[0] < SOON
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_handler_of_the_user_s_own_goes_first(frame):
    def handle(number, _):
        raise Enough(str(number))

    before = signal.signal(signal.SIGALRM, handle)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(Enough, match=str(int(signal.SIGALRM))):
            sspc.fit(**frame, steps=ENDLESS)
    finally:
        signal.signal(signal.SIGALRM, before)


def test_ctrl_c_in_a_process_of_its_own(tmp_path):
    script = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    script += "import conftest, sspc; frame = conftest.make_frame(); "
    script += "sspc.fit(**frame, steps=10**7, progress=lambda told: print(told.step, flush=True))"
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "1\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert errors.rstrip().endswith("KeyboardInterrupt") and process.returncode in (130, -signal.SIGINT)


def test_other_threads_run_meanwhile(frame):
    done, ticks = threading.Event(), []

    def tick():
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.monotonic()
    sspc.fit(**frame, steps=ENDLESS, time_limit=1.0)
    end = time.monotonic()
    done.set()
    thread.join()
    assert sum(begin < at < end for at in ticks) > 20


def test_calls_from_many_threads_give_the_same_bits(model):
    frames = [make_frame(seed=seed) for seed in range(4)]

    def pictures(frame):
        return sspc.fit(**frame, steps=3).correct(**frame).picture, model.correct(**frame).picture

    expected = [pictures(frame) for frame in frames]
    with ThreadPoolExecutor(4) as pool:
        for own, alone in zip(pool.map(pictures, frames), expected):
            assert same_bits(own[0], alone[0]) and same_bits(own[1], alone[1])


@pytest.mark.parametrize("threads", [1, 3])
def test_the_number_of_threads_does_not_show(threads, tmp_path):
    frame = make_frame()
    script = "import conftest as c, sspc, sys; f = c.make_frame(); r = sspc.fit(**f, steps=3).correct(**f); "
    script += "assert r.report['threads'] == int(sys.argv[2]); r.picture.tofile(sys.argv[1])"
    command = [sys.executable, "-c", script, str(tmp_path / "picture"), str(threads)]
    environment = os.environ | {"RAYON_NUM_THREADS": str(threads)}
    subprocess.run(command, cwd=Path(__file__).parent, check=True, env=environment)
    expected = sspc.fit(**frame, steps=3).correct(**frame).picture
    assert (tmp_path / "picture").read_bytes() == expected.tobytes()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_process_is_refused_and_does_not_hang():
    script = """
import os, conftest, sspc
frame = conftest.make_frame()
model = sspc.fit(**frame, steps=1)
child = os.fork()
if child == 0:
    try:
        model.correct(**frame)
    except sspc.Error as error:
        os._exit(7 if error.code == 4 and "spawn" in error.advice else 8)
    os._exit(9)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    command = [sys.executable, "-W", "ignore", "-c", script]
    done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "7\n"
