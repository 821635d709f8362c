"""Runs GRAPH.onnx of every case in onnxruntime: `run_picture.py GRAPH [LIBRARY]`, LIBRARY with our operators.

The working folder holds cases.json, a list of cases: a folder each with a file NAME.f32 for every NAME and shape of its
arrays.json. This writes picture.f32, share.f32 and fallback.json into each. With our operators another number of
threads must give the same but for the order in which onnxruntime's convolutions add."""

import json
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime

graph, *libraries = sys.argv[1:]


def run(path, inputs, threads):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    for library in libraries:
        options.register_custom_ops_library(library)
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"]).run(None, inputs)


for folder in map(Path, json.loads(Path("cases.json").read_text())):
    path = folder / f"{graph}.onnx"
    onnx.checker.check_model(onnx.load(path), full_check=True)
    shapes = json.loads((folder / "arrays.json").read_text())
    inputs = {name: np.fromfile(folder / f"{name}.f32", np.float32).reshape(shape) for name, shape in shapes.items()}
    picture, share, fallback = run(path, inputs, 1)
    if libraries:
        again = run(path, inputs, 3)
        assert fallback == again[2], folder
        assert np.allclose(picture, again[0], rtol=1e-4, atol=1e-5 * np.nanmax(picture, initial=0)), folder
    picture.tofile(folder / "picture.f32")
    share.tofile(folder / "share.f32")
    (folder / "fallback.json").write_text(json.dumps(fallback.tolist()))
