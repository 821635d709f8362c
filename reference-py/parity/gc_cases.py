"""g_c, f_c and the activations: forward and gradients of every parameter."""

import numpy as np
import torch
from sspc_reference import activations, features, gc, window

from .case import Case, Inputs, double, stack


def magnitude(image, parameters, radius):
    """What mu_hat is the sum of, without signs: its ratio to |mu_hat| is the sum's condition number."""
    parameters = parameters.detach()
    padded = gc.mirror_pad(image, radius)[:, window.ORDER]
    bandwidths, centre = parameters[:, window.DISTANCES], parameters[:, activations.TAU : activations.TAU + 1]
    beta = {name: parameters[:, activations.SLOPES[f"beta_{name}"]].abs() for name in ("denoised", "albedo", "normal")}
    total, weights = 0, 0
    for _, u, _, weight in window.offsets(padded, bandwidths, centre, radius):
        size = weight * u.abs()
        weights = weights + size[:, window.LAST]
        total = total + size[:, window.RADIANCE]
        for name, part in (("denoised", window.DENOISED), ("albedo", window.ALBEDO), ("normal", window.NORMAL)):
            total = total + beta[name] * size[:, part]
    total = total / weights
    if parameters.shape[1] == activations.GATED_OUTPUTS:
        total = total + image[:, features.CHANNELS["denoised"]].abs()
    return total


def corrected(name, purpose, inputs, raw, radius, upstream, present=features.CHANNELS):
    """A case of mu_hat = g_c (or gated), from features, raw outputs and an upstream gradient."""
    facts = {
        "kind": "gc",
        "radius": radius,
        "outputs": int(raw.shape[0]),
        "features": [role for role in ("albedo", "normal", "visibility") if role in present],
    }
    case = Case(name, purpose, facts)
    image = double(inputs)
    raw_leaf = double(raw).requires_grad_()
    parameters = activations.activate(raw_leaf)
    parameters.retain_grad()
    mu_hat = gc.gated(image, parameters, radius)
    (mu_hat * double(upstream)).sum().backward()
    case.put(
        features=inputs,
        raw=raw,
        upstream=upstream,
        parameters=parameters[0],
        g=gc.correct(image, parameters, radius)[0],
        mu_hat=mu_hat[0],
        magnitude=magnitude(image, parameters, radius)[0].float(),
        d_parameters=parameters.grad[0],
        d_raw=raw_leaf.grad[0],
    )
    return case


def random_case(name, purpose, seed, height, width, radius=9, outputs=15):
    random = Inputs(seed)
    return corrected(
        name,
        purpose,
        stack(random.buffer(height, width)),
        random.normal(outputs, height, width),
        radius,
        random.normal(3, height, width),
    )


def missing_features():
    random = Inputs(31)
    buffer = random.buffer(8, 9)
    buffer["albedo"][:] = 0
    buffer["visibility"][:] = 0
    return corrected(
        "gc-missing-features",
        "No albedo and no visibility: planes of zeros, which the kernels may skip.",
        stack(buffer),
        random.normal(16, 8, 9),
        9,
        random.normal(3, 8, 9),
        present=("normal",),
    )


def high_dynamic_range():
    random = Inputs(32)
    buffer = random.buffer(9, 10)
    for role in ("radiance", "denoised"):
        buffer[role] = random.log_uniform(3, 9, 10, low=1e-6, high=1e5)
    return corrected(
        "gc-hdr",
        "Radiance and denoised colour from 1e-6 to 1e5, neighbours up to 11 decades apart.",
        stack(buffer),
        random.normal(16, 9, 10),
        9,
        random.normal(3, 9, 10),
    )


def extreme_outputs():
    random = Inputs(33)
    raw = random.random.choice(np.float32([-40, -20, -5, 0, 5, 20, 40]), (16, 9, 8))
    return corrected(
        "gc-extreme-outputs",
        "Raw outputs of up to +-40: saturated slopes, bandwidths from 6e-4 to 1e4, tau from 1e-4 to 40.",
        stack(random.buffer(9, 8)),
        raw,
        9,
        random.normal(3, 9, 8),
    )


def combination():
    """tanh(40) is 1 in float64 and tanh(0) is 0, so raw outputs can say f_c exactly."""
    random = Inputs(34)
    raw = random.normal(15, 8, 7)
    raw[0:3], raw[3:9] = 40, 0
    case = corrected(
        "fc",
        "f_c of Deep Combiner as the special case beta^z = 1, beta^rho = beta^n = 0 of g_c.",
        stack(random.buffer(8, 7)),
        raw,
        9,
        random.normal(3, 8, 7),
    )
    combined = gc.combine(double(case.arrays["features"]), double(case.arrays["parameters"]))
    if not np.allclose(combined[0].numpy(), case.arrays["g"], rtol=1e-14):
        raise ValueError("fc: the special case is not f_c")
    return case


def activation_curve():
    random = Inputs(35)
    curve = np.concatenate([np.linspace(-40, 40, 161), [-1e-3, 1e-3, -1e-6, 1e-6]])
    raw = np.broadcast_to(curve.astype(np.float32), (16, 1, curve.size)).copy()
    upstream = random.normal(*raw.shape)
    case = Case(
        "activations",
        "Every activation and its gradient on raw outputs from -40 to 40 and close to 0.",
        {"kind": "activations", "outputs": 16},
    )
    leaf = double(raw).requires_grad_()
    parameters = activations.activate(leaf)
    (parameters * double(upstream)).sum().backward()
    case.put(raw=raw, upstream=upstream, parameters=parameters[0], d_raw=leaf.grad[0])
    return case


def cases():
    torch.set_grad_enabled(True)
    return [
        random_case("gc", "The paper's form at an odd size.", 1, 13, 11),
        random_case("gc-gated", "The gated form, mu_hat = z + s (g_c - z).", 2, 12, 11, outputs=16),
        random_case("gc-1x1", "One pixel: all 360 neighbours are mirror images of it.", 3, 1, 1),
        random_case("gc-1x7", "One row, folded into the window several times.", 4, 1, 7, outputs=16),
        random_case("gc-5x3", "Smaller than the window: borders mirrored several times.", 5, 5, 3),
        random_case("gc-33x2", "Taller than the window, two columns.", 6, 33, 2),
        random_case("gc-radius-3", "A 7x7 window.", 7, 9, 10, radius=3, outputs=16),
        random_case("gc-radius-12", "A 25x25 window.", 8, 7, 8, radius=12),
        missing_features(),
        high_dynamic_range(),
        extreme_outputs(),
        combination(),
        activation_curve(),
    ]
