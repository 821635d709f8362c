"""Runs both graphs in onnxruntime. The working folder holds network.onnx, image.onnx and a file NAME.f32 for every NAME
and shape of arrays.json; this writes parameters.f32, corrected.f32 and halves.f32."""

import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime

shapes = json.loads(Path("arrays.json").read_text())
arrays = {name: np.fromfile(f"{name}.f32", np.float32).reshape(shape) for name, shape in shapes.items()}
for graph in ("network.onnx", "image.onnx"):
    onnx.checker.check_model(onnx.load(graph), full_check=True)

network = onnxruntime.InferenceSession("network.onnx")
network.run(None, {"features": arrays["features"]})[0].tofile("parameters.f32")
image = onnxruntime.InferenceSession("image.onnx")
inputs = {i.name: arrays[i.name] for i in image.get_inputs()}
for name, value in zip(("corrected", "halves"), image.run(None, inputs)):
    value.tofile(f"{name}.f32")
