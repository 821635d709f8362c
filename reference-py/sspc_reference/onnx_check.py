"""Runs an exported ONNX file in onnxruntime and compares it with PyTorch on the same weights.

Two graphs are known: `sspc_network` (features -> activated parameters) and `sspc_image` (images ->
corrected radiance). The weights are read from the file itself, so that nothing but the file is
needed, and the reference computes in float64.
"""

from dataclasses import dataclass

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import numpy_helper

from . import activations, features, gc
from . import network as networks

NETWORK_GRAPH = "sspc_network"
IMAGE_GRAPH = "sspc_image"

# float32 in onnxruntime against float64 here, of an output's largest value: nine layers and, in the
# image graph, 361 weights.
TOLERANCE = 1e-5


class CheckFailed(ValueError):
    """The file is not as expected, or its results differ."""


@dataclass
class Model:
    """An exported model."""

    graph: str
    network: networks.Network
    radius: int
    session: onnxruntime.InferenceSession


def load(path):
    """Reads, validates and opens an exported file."""
    proto = onnx.load(str(path))
    onnx.checker.check_model(proto, full_check=True)
    graph = proto.graph.name
    if graph not in (NETWORK_GRAPH, IMAGE_GRAPH):
        raise CheckFailed(f"{path}: expected a graph {NETWORK_GRAPH} or {IMAGE_GRAPH}, found {graph}")
    metadata = {entry.key: entry.value for entry in proto.metadata_props}
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(proto.SerializeToString(), options, providers=["CPUExecutionProvider"])
    radius = int(metadata.get("sspc.window_radius", gc.RADIUS))
    return Model(graph, read_network(path, proto), radius, session)


def read_network(path, proto):
    """The file's weights, conv0.weight, conv0.bias, conv1.weight, ..., in a float64 network."""
    stored = {tensor.name: tensor for tensor in proto.graph.initializer}
    names = [f"conv{layer}.{kind}" for layer in range(networks.HIDDEN_LAYERS + 1) for kind in ("weight", "bias")]
    missing = [name for name in names if name not in stored]
    if missing:
        raise CheckFailed(f"{path}: no initializer {missing[0]} of the nine-layer network")
    arrays = [numpy_helper.to_array(stored[name]) for name in names]
    network = networks.Network(arrays[-1].size).double()
    for name, array, values in zip(names, arrays, network.parameters()):
        if array.shape != tuple(values.shape):
            raise CheckFailed(f"{path}: {name} expected shape {tuple(values.shape)}, found {array.shape}")
    flat = np.concatenate([array.reshape(-1) for array in arrays])
    network.load_flat(torch.from_numpy(flat).double())
    return network


def inputs_of(half_features, exposure=1.0):
    """Features [N, 13, H, W] as the image graph's inputs, colours in units of 1 / exposure."""
    named = {name: features.part(half_features, name).float().numpy() for name in features.CHANNELS}
    named["radiance"] = named["radiance"] / np.float32(exposure)
    named["denoised"] = named["denoised"] / np.float32(exposure)
    named["exposure"] = np.array([exposure], np.float32)
    return named


def check(model, half_features):
    """Runs the file on features [N, 13, H, W] and compares; returns {output: worst difference}.

    Differences are relative to the output's largest value; raises CheckFailed above TOLERANCE.
    """
    image = half_features.float().double()
    with torch.no_grad():
        parameters = activations.activate(model.network(image))
        if model.graph == NETWORK_GRAPH:
            feed = {"features": image.float().numpy()}
            expected = {"parameters": parameters}
        else:
            exposure = 2.0
            feed = inputs_of(image, exposure)
            halves = gc.gated(image, parameters, model.radius) / exposure
            mean = halves.mean(dim=0, keepdim=True).clamp_min(0)
            expected = {"corrected": mean, "halves": halves}
    found = model.session.run(list(expected), feed)
    worst = {}
    for (name, reference), result in zip(expected.items(), found):
        if result.shape != tuple(reference.shape):
            raise CheckFailed(f"{name}: expected shape {tuple(reference.shape)}, found {result.shape}")
        if name == "parameters":
            worst |= compare_parameters(reference.numpy(), result)
        else:
            worst[name] = compare(name, reference.numpy(), result)
    return worst


def compare_parameters(expected, found):
    """Slopes, each bandwidth, tau and gate on their own scale."""
    groups = {"beta": slice(0, 9), **{f"channel {c}": slice(c, c + 1) for c in range(9, expected.shape[1])}}
    return {name: compare(name, expected[:, where], found[:, where]) for name, where in groups.items()}


def compare(name, expected, found):
    """The worst difference relative to the largest expected value."""
    scale = np.abs(expected).max()
    error = np.abs(found.astype(np.float64) - expected)
    worst = float(error.max() / scale) if scale > 0 else float(error.max())
    if not worst <= TOLERANCE:
        at = tuple(int(i) for i in np.unravel_index(np.nan_to_num(error, nan=np.inf).argmax(), error.shape))
        raise CheckFailed(
            f"{name}: off by {worst:.2e} of the largest value (at most {TOLERANCE:.0e}), worst at {at}: "
            f"expected {expected[at]:.9g}, found {found[at]:.9g}"
        )
    return worst
