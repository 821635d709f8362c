"""Command line: sspc-reference fit | evaluate | compare | time | onnx."""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import torch

from . import activations, compare, evaluate, fit, onnx_check, read
from . import network as networks
from .features import CHANNELS, BadInput


def main(arguments=None):
    options = command_line().parse_args(arguments)
    torch.set_num_threads(options.threads)
    try:
        return options.run(options)
    except (BadInput, ValueError, OSError) as error:
        print(f"sspc-reference: {error}", file=sys.stderr)
        return 1


def command_line():
    parser = argparse.ArgumentParser(prog="sspc-reference", description="Self-supervised post-correction in PyTorch.")
    parser.add_argument("--threads", type=int, default=1, help="PyTorch's threads (default 1)")
    commands = parser.add_subparsers(required=True)

    command = commands.add_parser("fit", help="fit a frame, write its weights and corrected image")
    add_frame(command)
    add_schedule(command)
    command.add_argument("--weights", required=True, help="written: flat weights, .npy")
    command.add_argument("-o", "--output", help="written: the corrected image, EXR")
    command.add_argument("--reference", help="print relL2 against this EXR")
    command.set_defaults(run=run_fit)

    command = commands.add_parser("evaluate", help="correct with given weights, print relL2")
    add_frame(command)
    command.add_argument("--weights", required=True, help="flat weights, .npy")
    command.add_argument("-o", "--output", help="written: the corrected image, EXR")
    command.add_argument("--reference", required=True, help="EXR: R,G,B and, if any, a.R... b.R...")
    command.set_defaults(run=run_evaluate)

    command = commands.add_parser("compare", help="name the first stage at which two runs differ")
    command.add_argument("expected", help="stages of the reference, .npz")
    command.add_argument("found", help="stages of the other implementation, .npz")
    command.add_argument("--image", help="written: error map of the first differing stage, PNG")
    command.set_defaults(run=run_compare)

    command = commands.add_parser("time", help="time the steps of a fit, print JSON with its losses")
    add_frame(command)
    add_schedule(command)
    command.add_argument("--plan", help="a parity case's weights, tiles and rates instead of a preset")
    command.set_defaults(run=run_time)

    command = commands.add_parser("onnx", help="run an exported file in onnxruntime and compare")
    command.add_argument("model", help="ONNX: the network graph or the image graph")
    add_frame(command)
    command.set_defaults(run=run_onnx)
    return parser


def add_frame(command):
    command.add_argument("a", help="EXR of half a: R,G,B, denoised.*, albedo.*, normal.*, visibility.Y")
    command.add_argument("b", help="EXR of half b")
    command.add_argument("--denoised", help="EXR: the denoiser's output on the full buffer")
    command.add_argument(
        "--scale",
        type=float,
        default=1.0,
        help="exposure: colours are multiplied by it before anything else (default 1)",
    )


def add_schedule(command):
    command.add_argument("--preset", choices=["paper", "tiles"], default="tiles")
    command.add_argument("--epochs", type=int, default=20, help="of the paper's preset")
    command.add_argument("--steps", type=int, default=100, help="of the tile preset")
    command.add_argument("--rate", type=float, default=3e-3, help="of the tile preset")
    command.add_argument("--gate", action="store_true", help="16 outputs: the gated form")
    command.add_argument("--seed", type=int, default=0)


def load_frame(options):
    frame = read.read_frame(options.a, options.b, options.denoised)
    for role in frame.absent:
        print(f"no {role}: its channels are zero", file=sys.stderr)
    return frame.scaled(options.scale)


def start(options, frame):
    """The network at its start and the schedule, by preset."""
    outputs = activations.GATED_OUTPUTS if options.gate else activations.PAPER_OUTPUTS
    network = networks.Network(outputs)
    generator = torch.Generator().manual_seed(options.seed)
    if options.preset == "paper":
        networks.uniform_start(network, generator)
        return network, fit.paper_schedule(frame, options.seed, options.epochs)
    networks.near_denoised_start(network, generator)
    return network, fit.tile_schedule(frame, options.seed, options.steps, rate=options.rate)


def run_fit(options):
    frame = load_frame(options)
    network, schedule = start(options, frame)
    count = len(schedule.steps)

    def report(step, value):
        print(f"step {step + 1}/{count}  loss {value:.6f}", file=sys.stderr)

    fit.fit(network, frame, schedule, report=report)
    np.save(options.weights, network.flat().numpy())
    return finish(options, network, frame)


def run_evaluate(options):
    weights = torch.from_numpy(np.load(options.weights))
    frame = load_frame(options)
    paper = networks.Network(activations.PAPER_OUTPUTS)
    gated = networks.Network(activations.GATED_OUTPUTS)
    network = paper if weights.numel() == paper.flat().numel() else gated
    network.load_flat(weights)
    return finish(options, network, frame)


def finish(options, network, frame):
    """Writes the corrected image and prints relL2 of all images, if requested."""
    images = {"corrected": evaluate.corrected_image(network, frame)}
    if frame.denoised is not None:
        images["corrected, full z"] = evaluate.corrected_with_full_denoised(network, frame)
        images["denoised"] = frame.denoised
    mean = (frame.a + frame.b) / 2
    images["denoised halves"] = mean[:, CHANNELS["denoised"]]
    images["noisy"] = mean[:, CHANNELS["radiance"]]
    if options.output:
        read.write_image(options.output, images["corrected"] / options.scale)
    if options.reference:
        reference, halves = read.read_reference(options.reference)
        for name, image in images.items():
            value = evaluate.relative_l2(image / options.scale, reference, halves).item()
            print(json.dumps({"image": name, "relL2": value}))
    return 0


def planned(folder):
    """The network and the schedule of a parity case with weights_start, origins and rates."""
    folder = Path(folder)
    size = json.loads((folder / "case.json").read_text())["tile"]
    with np.load(folder / "io.npz") as case:
        network = networks.Network(activations.PAPER_OUTPUTS)
        network.load_flat(torch.from_numpy(case["weights_start"]))
        steps = [
            fit.Step([fit.Tile(int(top), int(left), size, size) for top, left in origins], float(rate))
            for origins, rate in zip(case["origins"], case["rates"])
        ]
    return network, fit.Schedule(steps)


def run_time(options):
    frame = load_frame(options)
    network, schedule = planned(options.plan) if options.plan else start(options, frame)
    stamps = [time.perf_counter()]
    losses = fit.fit(network, frame, schedule, report=lambda step, value: stamps.append(time.perf_counter()))
    seconds = np.diff(stamps)
    pixels = sum(tile.height * tile.width for tile in schedule.steps[0].tiles)
    record = {
        "implementation": f"torch {torch.__version__}",
        "threads": options.threads,
        "preset": options.plan or options.preset,
        "steps": len(schedule.steps),
        "tiles_per_step": len(schedule.steps[0].tiles),
        "pixels_per_step": pixels,
        "seconds": float(seconds.sum()),
        "median_seconds_per_step": float(np.median(seconds)),
        "losses": losses,
    }
    print(json.dumps(record))
    return 0


def run_onnx(options):
    frame = load_frame(options)
    worst = onnx_check.check(onnx_check.load(options.model), torch.cat([frame.a, frame.b]))
    for name, value in worst.items():
        print(json.dumps({"output": name, "worst_relative_difference": value}))
    return 0


def run_compare(options):
    report = compare.first_difference(np.load(options.expected), np.load(options.found))
    print(report.text)
    if report.differs and options.image:
        compare.write_error_map(options.image, report.error)
    return 1 if report.differs else 0


if __name__ == "__main__":
    sys.exit(main())
