"""The network in four engines on the same features, g_c alone and in onnxruntime, the picture graphs, and
`sspc-infer run` file to file, in one run: the record of speed.

A time counts only if the answer is right: the parameters of onnxruntime and PyTorch must equal ours to 1e-4 of a
channel's largest value, g_c and the finished pictures to 1e-3. Times are the minimum of the repeats; on a busy machine
compare core-seconds.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from datetime import datetime
from functools import partial
from pathlib import Path

from . import common, derived, machine

ROOT = common.REPOSITORY
DESCRIPTION = f"""\
Measures the network in four engines on the same features, g_c by our kernels and by our operator in onnxruntime, the
picture graphs in onnxruntime, and `sspc-infer run` file to file, and writes a dated record (table, JSON). Everything is
also given as a ratio to onnxruntime or to our kernels, and to the machine's peak, measured in the same run.
Build the programs first: `{common.BUILD}`.
Run it with the interpreter that .ci/setup-python prints."""
# Rows of the parameters that engine_speed writes are this far apart.
ROW_STEP = 97
LIBRARY = "libsspc_operators.so"
# Nine layers of f32 sums in another order, then activations; of a channel's largest value.
TOLERANCE = 1e-4
# g_c of parameters that differ by as much, and finished pictures; of a channel's largest value.
PICTURE_TOLERANCE = 1e-3
# The size of the picture graphs: in standard operators they hold 640 planes.
PICTURE_SIZE = (640, 360)


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


def session(graph, threads, library=None):
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    if library:
        options.register_custom_ops_library(str(library))
    return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def operator_graph():
    """A graph of our operator alone, in the paper's window."""
    from onnx import TensorProto, helper

    names = ["features", "parameters", "valid"]
    node = helper.make_node("PostCorrection", names, ["corrected"], domain="sspc", window_radius=9)
    inputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [None] * 4) for name in names]
    outputs = [helper.make_tensor_value_info("corrected", TensorProto.FLOAT, [None] * 4)]
    sets = [helper.make_opsetid("", 17), helper.make_opsetid("sspc", 1)]
    graph = helper.make_graph([node], "g_c", inputs, outputs)
    return helper.make_model(graph, opset_imports=sets, ir_version=8).SerializeToString()


def with_operator(library, features, parameters, repeats, threads):
    import numpy as np

    inputs = dict(features=features, parameters=parameters, valid=np.ones_like(features[:, :1]))
    running = session(operator_graph(), threads, library)
    return timed(lambda: running.run(None, inputs)[0], repeats)


def operator_library(programs):
    """The library that onnxruntime loads: beside the programs, or beside what they were built of."""
    found = [path for path in (programs / LIBRARY, programs / "deps" / LIBRARY) if path.is_file()]
    return found[0] if found else common.fail(f"{programs / LIBRARY} does not exist; run `{common.BUILD}`")


def check(name, found, expected, tolerance=TOLERANCE):
    """Compares the rows that engine_speed wrote."""
    rows = found[0, :, ::ROW_STEP].transpose(1, 0, 2)
    return compare(name, rows, expected.reshape(rows.shape), (0, 2), tolerance)


def compare(name, found, expected, axes, tolerance):
    """The worst difference of a channel's largest value, which lies along `axes`."""
    import numpy as np

    scale = np.abs(expected).max(axis=axes, keepdims=True)
    worst = float((np.abs(found - expected) / scale).max())
    if not worst <= tolerance:
        raise WrongAnswer(f"{name}: {worst:.1e} of the largest value off, at most {tolerance:.0e}")
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
            if name == "onnxruntime":
                parameters = found
        found, seconds, core_seconds = with_operator(operator_library(programs), features, parameters, repeats, threads)
        name = "g_c of one half, our operator in onnxruntime"
        worst = check(name, found, np.fromfile(Path(folder, "corrected.f32"), np.float32), PICTURE_TOLERANCE)
        flop = next(line["gflop"] for line in lines if line["name"] == "g_c of one half")
        lines.append(dict(name=name, seconds=seconds, core_seconds=core_seconds, gflop=flop, worst=worst))
    return lines


def picture_inputs(width, height):
    """Halves of a made-up frame: a smooth picture, its noise, and z a little off."""
    import numpy as np

    rng = np.random.default_rng(1)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    truth = np.stack([0.4 + 0.3 * np.sin((x * (1 + k) + y) / 40) for k in range(3)])
    shape = (2, 3, height, width)
    features = np.broadcast_to(np.stack([x / width, y / height, (x + y) % 64 / 64]), shape)
    return dict(
        radiance=np.maximum(truth * (1 + 0.4 * rng.standard_normal(shape)), 0).astype(np.float32),
        denoised=(truth * (1 + 0.02 * rng.standard_normal(shape))).astype(np.float32),
        denoised_full=truth[None].astype(np.float32),
        albedo=features.astype(np.float32),
        normal=(2 * features - 1).astype(np.float32),
        visibility=features[:, :1].astype(np.float32),
        exposure=np.ones(1, np.float32),
        strength=np.ones(1, np.float32),
    )


def measure_pictures(programs, repeats, threads):
    """The finished picture by both graphs in onnxruntime: name, seconds, core-seconds, worst difference."""
    width, height = PICTURE_SIZE
    inputs, lines, first = picture_inputs(width, height), [], None
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([programs / "examples/write_graphs", folder, "gated"], check=True)
        for graph, library in [("picture", None), ("operators", operator_library(programs))]:
            running = session(str(Path(folder, f"{graph}.onnx")), threads, library)
            (picture, share, fallback), *times = timed(partial(running.run, None, inputs), repeats)
            if fallback[0] or not 0.01 < share.mean() < 0.99:
                raise WrongAnswer(f"{graph}: nothing to see, fallback {fallback[0]}, mean share {share.mean():.3f}")
            first = picture if first is None else first
            worst = compare(graph, picture, first, (0, 2, 3), PICTURE_TOLERANCE)
            lines.append(dict(name=graph, seconds=times[0], core_seconds=times[1], worst=worst))
    return lines


def picture_table(lines):
    width, height = PICTURE_SIZE
    least = lines[-1]["core_seconds"]
    table = [
        f"### The finished picture in onnxruntime, {width} x {height}, nine layers, windows of 19 x 19",
        "",
        "| graph | seconds | core-seconds | core-µs a pixel | / operators |",
        "|---|---|---|---|---|",
    ]
    for line in lines:
        times = f"{line['seconds']:.2f} | {line['core_seconds']:.2f}"
        micro = line["core_seconds"] * 1e6 / (width * height)
        table.append(f"| {line['name']} | {times} | {micro:.2f} | {line['core_seconds'] / least:.1f} |")
    return "\n".join(table)


def engine_table(lines, height, width):
    peak = next(line for line in lines if line["name"] == "peak of a core")
    most = peak["gflop"] / peak["core_seconds"]
    ort = next(line for line in lines if line["name"] == "onnxruntime")["core_seconds"]
    table = [
        f"### {width} x {height}",
        "",
        f"A core's multiply-adds alone: {most:.0f} GFLOP/s.",
        "",
        "| | seconds | core-seconds | core-µs a pixel | ratio | GFLOP per core-second | of the peak |",
        "|---|---|---|---|---|---|---|",
    ]
    gc = next(line for line in lines if line["name"] == "g_c of one half")["core_seconds"]
    for line in lines:
        if line is peak:
            continue
        rate = line["gflop"] / line["core_seconds"]
        of_gc = line["name"].startswith("g_c")
        # The network's to onnxruntime's, g_c's to that of our kernels.
        ratio = line["core_seconds"] / (gc if of_gc else ort)
        times = f"{line['seconds']:.2f} | {line['core_seconds']:.2f}"
        micro = line["core_seconds"] * 1e6 / (width * height)
        table.append(f"| {line['name']} | {times} | {micro:.2f} | {ratio:.2f} | {rate:.0f} | {rate / most:.0%} |")
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
    parts = ["read", "features", "correct", "write"]
    names = ["read, look over", "features", "network, g_c, judge", "write"]
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
    common.add_output(parser)
    options = parser.parse_args(arguments)
    threads = options.threads or len(os.sched_getaffinity(0))
    program = common.program(options, "sspc-infer")
    programs = program.parent
    about = common.about("bench/network", arguments, options, [program, operator_library(programs)])
    figures, tables = dict(engines=[], pictures=[], runs=[]), []

    def add(kind, figure, table):
        figures[kind].append(figure)
        tables.append(table)
        print(table + "\n", flush=True)

    for width, height in options.sizes:
        lines = measure_engines(programs, height, width, options.repeats, threads)
        add("engines", dict(width=width, height=height, lines=lines), engine_table(lines, height, width))
        with tempfile.TemporaryDirectory() as folder:
            for name in ("a.exr", "b.exr", "denoised.exr"):
                source = ROOT / "tests/data/sample" / name
                derived.mirror(programs / "examples/edit_exr", source, Path(folder, name), width, height)
            model = model_for(programs, folder)
            report = measure_run(programs, folder, model, options.repeats, threads)
            add("runs", report, run_table(report))
    pictures = measure_pictures(programs, options.repeats, threads)
    add("pictures", pictures, picture_table(pictures))
    about["load_average_after"] = machine.load()
    for path in write(options.output, about, figures, tables, threads):
        print(f"wrote {path}", file=sys.stderr)
    return 0


def write(folder, about, figures, tables, threads):
    """The record's two files, network-DATE-COMMIT.md and .json; their paths."""
    host, dirty = about["machine"], about["commit"]["dirty"]
    day = datetime.fromisoformat(about["date"]).date().isoformat()
    stem = f"network-{day}-{about['commit']['hash']}{'-dirty' if dirty else ''}"
    head = [
        f"# Speed of the kernels, {day}",
        "",
        f"Command `{about['command']}`, commit {about['commit']['hash']}{', changed' if dirty else ''}. "
        f"{host['processor']}, {threads} threads of {host['cores_usable']} cores usable, {host['system']}; "
        f"load average {host['load_average_before'][0]} before, {about['load_average_after'][0]} after. "
        "A network's ratio is to onnxruntime's core-seconds, that of g_c to our kernels'.",
        "",
    ]
    folder.mkdir(parents=True, exist_ok=True)
    texts = {".md": "\n".join([*head, "\n\n".join(tables), ""]), ".json": json.dumps(about | figures, indent=1) + "\n"}
    for ending, text in texts.items():
        Path(folder, stem + ending).write_text(text)
    return [Path(folder, stem + ending) for ending in texts]
