"""A parity case: what it holds, how it is written, and when a regenerated one counts as the same."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

# Regenerated float64 values may differ in the last digits where the machine's libm or the order of
# a sum differs; thousandfold below the tightest parity tolerance (1e-6).
FLOAT64_SAME = 1e-9
# Large arrays are stored rounded to float32 (6e-8); a last digit may then flip.
FLOAT32_SAME = 2.5e-7


@dataclass
class Case:
    name: str
    # One line: what this case is meant to catch.
    purpose: str
    # Facts other than arrays: radius, form, Adam's constants.
    facts: dict
    arrays: dict = field(default_factory=dict)

    def put(self, **arrays):
        """Adds arrays: inputs as float32 or integers, results as float64 (or rounded float32)."""
        for name, values in arrays.items():
            if isinstance(values, torch.Tensor):
                values = values.detach().numpy()
            if not np.isfinite(values).all():
                raise ValueError(f"{self.name}: {name} is not finite")
            self.arrays[name] = np.ascontiguousarray(values)

    def write(self, root):
        folder = Path(root) / self.name
        folder.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(folder / "io.npz", **self.arrays)
        (folder / "case.json").write_text(json.dumps(self.facts, indent=2) + "\n")
        (folder / "README.md").write_text(self.purpose + "\n")

    def differences(self, root):
        """What differs in the case of this name under `root`: a list of lines, empty if nothing."""
        folder = Path(root) / self.name
        if not (folder / "io.npz").is_file():
            return [f"{self.name}: no such case"]
        lines = []
        if json.loads((folder / "case.json").read_text()) != json.loads(json.dumps(self.facts)):
            lines.append(f"{self.name}: case.json differs")
        if (folder / "README.md").read_text() != self.purpose + "\n":
            lines.append(f"{self.name}: README.md differs")
        with np.load(folder / "io.npz") as stored:
            if set(stored.files) != set(self.arrays):
                names = sorted(set(stored.files) ^ set(self.arrays))
                lines.append(f"{self.name}: only in one of both: {names}")
            for name in sorted(set(stored.files) & set(self.arrays)):
                problem = difference(self.arrays[name], stored[name])
                if problem:
                    lines.append(f"{self.name}: {name} {problem}")
        return lines


def difference(expected, found):
    """Describes how two arrays differ; None if they do not."""
    if expected.shape != found.shape or expected.dtype != found.dtype:
        return f"expected {expected.dtype}{list(expected.shape)}, found {found.dtype}{list(found.shape)}"
    if expected.dtype.kind in "iu":
        return "" if np.array_equal(expected, found) else "differs"
    same = FLOAT64_SAME if expected.dtype == np.float64 else FLOAT32_SAME
    scale = np.abs(expected).max(initial=0.0)
    error = np.abs(expected.astype(np.float64) - found.astype(np.float64)).max(initial=0.0)
    if not error <= same * scale:
        return f"differs by {error:.3g}, largest value {scale:.3g}"
    return ""


class Inputs:
    """Random inputs that float32 holds exactly; one seed per case.

    Weights and raw outputs are rounded to float16 first: half of their digits compress away.
    """

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def uniform(self, *shape, low=0.0, high=1.0):
        return self.random.uniform(low, high, shape).astype(np.float32)

    def normal(self, *shape, scale=1.0):
        return short(scale * self.random.standard_normal(shape))

    def log_uniform(self, *shape, low, high):
        exponent = self.random.uniform(np.log(low), np.log(high), shape)
        return np.exp(exponent).astype(np.float32)

    def buffer(self, height, width):
        """One buffer's planes by role: noisy around z, z around an edge, features with a step."""
        step = (np.arange(width) > width / 2).astype(np.float32)
        albedo = 0.3 + 0.4 * step + 0.05 * self.uniform(3, height, width)
        normal = self.normal(3, height, width, scale=0.1)
        normal[2] += 1 - step
        normal[0] += step
        denoised = albedo * self.uniform(3, height, width, low=0.6, high=1.4)
        noisy = denoised * self.uniform(3, height, width, low=0.2, high=1.9)
        return {
            "radiance": noisy.astype(np.float32),
            "albedo": albedo.astype(np.float32),
            "visibility": (step + self.uniform(1, height, width, high=0.3)).clip(0, 1),
            "normal": normal.clip(-1, 1),
            "denoised": denoised.astype(np.float32),
        }


def short(array):
    """Rounded to float16, as float32."""
    return np.asarray(array).astype(np.float16).astype(np.float32)


def double(array):
    """A float32 array as a float64 tensor with a batch axis in front."""
    return torch.from_numpy(np.asarray(array)).double()[None]


def stack(buffer):
    """A buffer's features [13, H, W], float32."""
    return np.concatenate(list(buffer.values()))
