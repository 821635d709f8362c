"""Breaks the graph with our operator, its inputs and its library, and prints what onnxruntime says:
`refused.py LIBRARY OTHER`, in a folder with operators.onnx. OTHER is a library that is not there."""

import os
import sys

import numpy as np
import onnxruntime
from onnx import TensorProto, helper

library, other = sys.argv[1:]


def session(graph, path=library, threads=1):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4
    if path:
        options.register_custom_ops_library(path)
    return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def node(kind=TensorProto.FLOAT, **attributes):
    """A graph of the operator alone, of tensors of any shape."""
    names = ["features", "parameters", "valid"]
    operator = helper.make_node("PostCorrection", names, ["corrected"], domain="sspc", **attributes)
    inputs = [helper.make_tensor_value_info(name, kind, None) for name in names]
    graph = helper.make_graph([operator], "one", inputs, [helper.make_tensor_value_info("corrected", kind, None)])
    sets = [helper.make_opsetid("", 17), helper.make_opsetid("sspc", 1)]
    return helper.make_model(graph, opset_imports=sets, ir_version=8).SerializeToString()


def run(features, parameters=(1, 16, 4, 5), valid=(1, 1, 4, 5), value=0.5):
    shapes = dict(features=features, parameters=parameters, valid=valid)
    values = {name: np.full(shape, value, np.float32) for name, shape in shapes.items()}
    values["valid"][...] = 1
    return session(node(window_radius=9)).run(None, values)[0]


def refused(what, work):
    try:
        work()
    except Exception as error:
        print(f"{what}: {' '.join(str(error).split())}")
    else:
        sys.exit(f"{what}: not refused")


refused("no library", lambda: session("operators.onnx", None))
refused("a library that is not there", lambda: session("operators.onnx", other))
refused("radius 13", lambda: session(node(window_radius=13)))
refused("no radius", lambda: session(node()))
refused("doubles", lambda: session(node(TensorProto.DOUBLE, window_radius=9)))
os.environ["SSPC_ISA"] = "mmx"
refused("instruction set", lambda: session("operators.onnx"))
del os.environ["SSPC_ISA"]
refused("features", lambda: run((1, 12, 4, 5)))
refused("rank", lambda: run((13, 4, 5)))
refused("parameters", lambda: run((1, 13, 4, 5), (1, 14, 4, 5)))
refused("valid", lambda: run((1, 13, 4, 5), valid=(1, 1, 5, 4)))
print("empty:", run((2, 13, 0, 5), (2, 16, 0, 5), (1, 1, 0, 5)).shape)
found = run((1, 13, 4, 5), value=np.nan)
print("NaN:", "kept z" if np.isnan(found).all() else found)
rng = np.random.default_rng(1)
sizes = dict(features=(2, 13, 70, 300), parameters=(2, 16, 70, 300), valid=(1, 1, 70, 300))
values = {name: rng.random(size, np.float32) for name, size in sizes.items()}
values["valid"] = (values["valid"] > 0.01).astype(np.float32)
found = [session(node(window_radius=4), threads=threads).run(None, values)[0] for threads in (1, 2, 5)]
print("threads:", "the same" if all(np.array_equal(found[0], other) for other in found[1:]) else "others")
