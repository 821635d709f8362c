"""The onnxruntime check passes on a correct file and fails on a wrong one; the files are made with onnx itself."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from samples import generator, random_features
from sspc_reference import network, onnx_check


def exported(outputs=16, floor=1e-4, graph=onnx_check.NETWORK_GRAPH):
    """A network graph as another exporter would write it."""
    net = network.Network(outputs)
    network.uniform_start(net, generator(1))
    nodes, stored, value = [], [], "features"

    def constant(name, array):
        stored.append(numpy_helper.from_array(np.asarray(array), name))

    for index, layer in enumerate(net.layers):
        constant(f"conv{index}.weight", layer.weight.detach().numpy())
        constant(f"conv{index}.bias", layer.bias.detach().numpy())
        names = [value, f"conv{index}.weight", f"conv{index}.bias"]
        nodes.append(helper.make_node("Conv", names, [f"c{index}"], pads=[1, 1, 1, 1]))
        value = f"c{index}"
        if index < network.HIDDEN_LAYERS:
            nodes.append(helper.make_node("Relu", [value], [f"r{index}"]))
            value = f"r{index}"
    constant("sizes", np.array([9, 5, 1, outputs - 15][: outputs - 12]))
    constant("floor", np.float32(floor))
    split = ["o_beta", "o_gamma", "o_tau", "o_gate"][: outputs - 12]
    nodes += [
        helper.make_node("Split", [value, "sizes"], split, axis=1),
        helper.make_node("Tanh", ["o_beta"], ["beta"]),
        helper.make_node("Softplus", ["o_gamma"], ["root"]),
        helper.make_node("Mul", ["root", "root"], ["square"]),
        helper.make_node("Add", ["square", "floor"], ["floored"]),
        helper.make_node("Reciprocal", ["floored"], ["gamma"]),
        helper.make_node("Softplus", ["o_tau"], ["soft_tau"]),
        helper.make_node("Add", ["soft_tau", "floor"], ["tau"]),
    ]
    parts = ["beta", "gamma", "tau"]
    if outputs == 16:
        nodes.append(helper.make_node("Sigmoid", ["o_gate"], ["gate"]))
        parts.append("gate")
    nodes.append(helper.make_node("Concat", parts, ["parameters"], axis=1))
    proto = helper.make_graph(
        nodes,
        graph,
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["N", 13, "H", "W"])],
        [helper.make_tensor_value_info("parameters", TensorProto.FLOAT, ["N", outputs, "H", "W"])],
        stored,
    )
    return helper.make_model(proto, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def saved(folder, model):
    path = folder / "model.onnx"
    onnx.save(model, str(path))
    return path


@pytest.mark.parametrize("outputs", [15, 16])
def test_a_right_file_passes(tmp_path, outputs):
    model = onnx_check.load(saved(tmp_path, exported(outputs)))
    for height, width in [(1, 1), (7, 10)]:
        worst = onnx_check.check(model, random_features(2, height, width, batch=2))
        assert len(worst) == outputs - 8 and max(worst.values()) <= onnx_check.TOLERANCE


def test_a_wrong_constant_fails(tmp_path):
    """The floor off by a thousandth, where it shows: gamma and tau of raw outputs near -6."""
    shifted = exported(floor=1.001e-4)
    for tensor in shifted.graph.initializer:
        if tensor.name == "conv8.bias":
            array = numpy_helper.to_array(tensor).copy()
            array[9:15] = -6
            tensor.CopyFrom(numpy_helper.from_array(array, tensor.name))
    with pytest.raises(onnx_check.CheckFailed, match="off by"):
        onnx_check.check(onnx_check.load(saved(tmp_path, shifted)), random_features(3, 5, 5))


def test_a_wrong_graph_fails(tmp_path):
    model = onnx_check.load(saved(tmp_path, exported()))
    model.network.layers[4].weight.data *= 1.001
    with pytest.raises(onnx_check.CheckFailed, match="beta: off by"):
        onnx_check.check(model, random_features(4, 5, 5))
    with pytest.raises(onnx_check.CheckFailed, match="found something_else"):
        onnx_check.load(saved(tmp_path, exported(graph="something_else")))


def test_missing_weights_are_named(tmp_path):
    model = exported()
    for tensor in model.graph.initializer:
        tensor.name = tensor.name.replace("conv3.bias", "other")
    for node in model.graph.node:
        node.input[:] = ["other" if name == "conv3.bias" else name for name in node.input]
    with pytest.raises(onnx_check.CheckFailed, match="no initializer conv3.bias"):
        onnx_check.load(saved(tmp_path, model))
