"""Runs picture.onnx in onnxruntime. The working folder holds cases.json, a list of cases: a folder each with a file
NAME.f32 for every NAME and shape of its arrays.json. This writes picture.f32, share.f32 and fallback.json into each."""

import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime

for folder in map(Path, json.loads(Path("cases.json").read_text())):
    onnx.checker.check_model(onnx.load(folder / "picture.onnx"), full_check=True)
    session = onnxruntime.InferenceSession(folder / "picture.onnx")
    shapes = json.loads((folder / "arrays.json").read_text())
    inputs = {name: np.fromfile(folder / f"{name}.f32", np.float32).reshape(shape) for name, shape in shapes.items()}
    picture, share, fallback = session.run(None, inputs)
    picture.tofile(folder / "picture.f32")
    share.tofile(folder / "share.f32")
    (folder / "fallback.json").write_text(json.dumps(fallback.tolist()))
