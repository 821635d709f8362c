"""The network in four engines on the same features, g_c alone, and `sspc-infer run` file to file, in one run.

A time counts only if the answer is right: the parameters of onnxruntime and PyTorch must equal ours to 1e-4 of a
channel's largest value. Times are the minimum of the repeats; on a busy machine compare core-seconds.
"""

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

from . import common, derived, machine

ROOT = common.REPOSITORY
DESCRIPTION = f"""\
Measures the network in four engines on the same features, g_c alone, and `sspc-infer run` file to file.
Build the programs first: `{common.BUILD}`.
Run it with the interpreter that .ci/setup-python prints."""
# Rows of the parameters that engine_speed writes are this far apart.
ROW_STEP = 97
# Nine layers of f32 sums in another order, then activations; of a channel's largest value.
TOLERANCE = 1e-4


class WrongAnswer(Exception):
    """An engine computes something else."""


def made_up_features(height, width):
    """As engine_speed makes them, [1, 13, H, W]."""
    import numpy as np

    c, y, x = np.ogrid[:13, :height, :width]
    return (((c * 31 + y * 17 + x * 7) % 101).astype(np.float32) / np.float32(101))[None]


def timed(work, repeats):
    """Result, least seconds and least core-seconds."""
    least = [float("inf"), float("inf")]
    for _ in range(repeats):
        begin, cpu = time.perf_counter(), time.process_time()
        result = work()
        least = [min(least[0], time.perf_counter() - begin), min(least[1], time.process_time() - cpu)]
    return result, *least


def with_onnxruntime(model, features, repeats, threads):
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    return timed(lambda: session.run(None, {"features": features})[0], repeats)


def with_pytorch(model, features, repeats, threads):
    import sys

    import onnx
    import torch
    from onnx import numpy_helper

    sys.path.insert(0, str(ROOT / "reference-py"))
    from sspc_reference import activations, network

    torch.set_num_threads(threads)
    stored = {tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load(str(model)).graph.initializer}
    layers = network.HIDDEN_LAYERS + 1
    names = [f"conv{layer}.{kind}" for layer in range(layers) for kind in ("weight", "bias")]
    net = network.Network(stored[names[-1]].size)
    net.load_flat(torch.cat([torch.from_numpy(stored[name].copy()).reshape(-1) for name in names]))
    image = torch.from_numpy(features)

    def work():
        with torch.no_grad():
            return activations.activate(net(image)).numpy()

    return timed(work, repeats)


def check(name, found, expected):
    """Compares the rows that engine_speed wrote."""
    import numpy as np

    rows = found[0, :, ::ROW_STEP].transpose(1, 0, 2)
    expected = expected.reshape(rows.shape)
    scale = np.abs(expected).max(axis=(0, 2), keepdims=True)
    worst = float((np.abs(rows - expected) / scale).max())
    if not worst <= TOLERANCE:
        raise WrongAnswer(f"{name}: {worst:.1e} of the largest value off, at most {TOLERANCE:.0e}")
    return worst


def measure_engines(programs, height, width, repeats, threads):
    """One line per engine: name, seconds, core-seconds, GFLOP, worst difference from ours."""
    import numpy as np

    environment = dict(os.environ, RAYON_NUM_THREADS=str(threads))
    with tempfile.TemporaryDirectory() as folder:
        command = [programs / "examples/engine_speed", folder, str(height), str(width), str(repeats)]
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        flop = next(line["gflop"] for line in lines if line["name"] == "tract")
        expected = np.fromfile(Path(folder, "rows.f32"), np.float32)
        features = made_up_features(height, width)
        for name, engine in [("onnxruntime", with_onnxruntime), ("PyTorch", with_pytorch)]:
            model = Path(folder, "network.onnx")
            found, seconds, core_seconds = engine(model, features, repeats, threads)
            worst = check(name, found, expected)
            lines.append(dict(name=name, seconds=seconds, core_seconds=core_seconds, gflop=flop, worst=worst))
    return lines


def engine_table(lines, height, width):
    peak = next(line for line in lines if line["name"] == "peak of a core")
    most = peak["gflop"] / peak["core_seconds"]
    ort = next(line for line in lines if line["name"] == "onnxruntime")["core_seconds"]
    table = [
        f"### {width} x {height}",
        "",
        f"A core's multiply-adds alone: {most:.0f} GFLOP/s.",
        "",
        "| | seconds | core-seconds | / onnxruntime | GFLOP per core-second | of the peak |",
        "|---|---|---|---|---|---|",
    ]
    for line in lines:
        if line is peak:
            continue
        rate = line["gflop"] / line["core_seconds"]
        ratio = "" if line["name"].startswith("g_c") else f"{line['core_seconds'] / ort:.2f}"
        times = f"{line['seconds']:.2f} | {line['core_seconds']:.2f}"
        table.append(f"| {line['name']} | {times} | {ratio} | {rate:.0f} | {rate / most:.0%} |")
    return "\n".join(table)


def measure_run(programs, folder, model, repeats, threads):
    """Reports of `sspc-infer run` on the frame in `folder`, and wall seconds of the whole process."""
    reports = []
    for _ in range(repeats):
        command = [programs / "sspc-infer", "run", "--model", model, "--quiet", "--json", "--threads", str(threads)]
        command += ["a.exr", "b.exr", "--denoised", "denoised.exr", "-o", "corrected.exr"]
        before = os.times()
        begin = time.perf_counter()
        subprocess.run(command, check=True, cwd=folder)
        wall, after = time.perf_counter() - begin, os.times()
        report = json.loads(Path(folder, "corrected.json").read_text())
        if not report["loss"]["corrected"] < report["loss"]["denoised"]:
            raise WrongAnswer("sspc-infer run: the loss does not fall")
        report["wall"] = wall
        report["core_seconds"] = sum(after[2:4]) - sum(before[2:4])
        reports.append(report)
    return min(reports, key=lambda report: report["wall"])


def run_table(report):
    seconds = report["seconds"]
    parts = ["read", "features", "network", "finish", "write"]
    names = ["read, look over", "features", "network", "g_c, judge", "write"]
    return "\n".join(
        [
            f"### `sspc-infer run`, {report['width']} x {report['height']}, file to file",
            "",
            "| wall | core-seconds | " + " | ".join(names) + " | to the first tile | most memory |",
            "|---" * (len(parts) + 4) + "|",
            f"| {report['wall']:.2f} | {report['core_seconds']:.2f} | "
            + " | ".join(f"{seconds[part]:.2f}" for part in parts)
            + f" | {report['first_tile_after']:.3f} | {report['peak_rss_bytes'] >> 20} MiB |",
        ]
    )


def model_for(programs, folder):
    """An untrained model: z plus a smoothed residual."""
    subprocess.run([programs / "examples/write_graphs", folder, "gated"], check=True)
    return Path(folder, "network.onnx")


def main(arguments=None):
    parser = common.parser("bench/network", DESCRIPTION)
    default = common.sizes("1280x720,3840x2160")
    parser.add_argument(
        "--sizes", type=common.sizes, default=default, metavar="WxH,WxH", help="default 1280x720,3840x2160"
    )
    parser.add_argument("--repeats", type=common.positive, default=3, metavar="N", help="default 3")
    options = parser.parse_args(arguments)
    threads = options.threads or len(os.sched_getaffinity(0))
    programs = common.program(options, "sspc-infer").parent

    about, head = machine.machine(threads), machine.commit(ROOT)
    load = about["load_average_before"][0]
    print(f"{about['processor']}, {threads} threads, load {load}, commit {head['hash']}\n")
    for width, height in options.sizes:
        lines = measure_engines(programs, height, width, options.repeats, threads)
        print(engine_table(lines, height, width) + "\n")
        with tempfile.TemporaryDirectory() as folder:
            for name in ("a.exr", "b.exr", "denoised.exr"):
                source = ROOT / "tests/data/sample" / name
                derived.mirror(programs / "examples/edit_exr", source, Path(folder, name), width, height)
            model = model_for(programs, folder)
            print(run_table(measure_run(programs, folder, model, options.repeats, threads)) + "\n")
    return 0
