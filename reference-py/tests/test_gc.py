"""g_c against Eq. 10 and 11 written as loops over pixels, and against what must hold by algebra."""

import math

import pytest
import torch
from samples import random_features, random_raw, uniform
from sspc_reference import activations, features, gc

# Two float64 computations of the same sums in a different order.
ROUNDING = 1e-12
# Central differences with step 1e-6: truncation 1e-12, rounding 1e-16 / 1e-6, condition some 10.
FINITE_DIFFERENCE = 1e-7


def fold(index, length):
    while not 0 <= index < length:
        index = -1 - index if index < 0 else 2 * length - 1 - index
    return index


def by_the_equations(image, parameters, radius):
    """g_c of one [13, H, W] image, pixel by pixel, tap by tap."""
    _, height, width = image.shape
    out = torch.zeros(3, height, width, dtype=image.dtype)
    for row in range(height):
        for column in range(width):
            p = parameters[:, row, column]
            beta_z, beta_rho, beta_n = p[0:3], p[3:6], p[6:9]
            gamma_rho, gamma_n, gamma_v, gamma_y, gamma_z, tau = p[9:15]
            c = image[:, row, column]
            numerator, total = torch.zeros(3, dtype=image.dtype), 0.0
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    i = image[:, fold(row + dy, height), fold(column + dx, width)]
                    y, rho, v, n, z = (c - i).split([3, 3, 1, 3, 3])
                    weight = torch.exp(
                        -gamma_rho * (rho @ rho)
                        - gamma_n * (n @ n)
                        - gamma_v * (v @ v)
                        - gamma_y * torch.log(1 + y @ y)
                        - gamma_z * torch.log(1 + z @ z)
                    )
                    if (dy, dx) == (0, 0):
                        weight = tau
                    numerator += weight * (i[0:3] + beta_z * z + beta_rho * rho + beta_n * n)
                    total += weight
            out[:, row, column] = numerator / max(total, 1e-5)
    return out


@pytest.mark.parametrize(("height", "width", "radius"), [(1, 1, 9), (1, 2, 9), (5, 3, 9), (7, 11, 3), (6, 4, 12)])
def test_correct_is_the_equation(height, width, radius):
    image = random_features(1, height, width)
    parameters = activations.activate(random_raw(2, height, width))
    expected = by_the_equations(image[0], parameters[0], radius)
    found = gc.correct(image, parameters, radius)[0]
    assert torch.allclose(found, expected, rtol=ROUNDING, atol=ROUNDING)


def test_each_kernel_constant_matters():
    """A thousandth on any parameter channel moves g_c by far more than the tolerances used on it."""
    image = random_features(3, 7, 6)
    parameters = activations.activate(random_raw(4, 7, 6))
    before = gc.correct(image, parameters)
    for channel in range(15):
        changed = parameters.clone()
        changed[:, channel] *= 1.001
        assert (gc.correct(image, changed) - before).abs().max() > 1e-6, channel


@pytest.mark.parametrize("outputs", [15, 16])
def test_gradients_are_finite_differences(outputs):
    image = random_features(5, 4, 5)
    raw = random_raw(6, 4, 5, outputs).requires_grad_()
    upstream = uniform(7, 1, 3, 4, 5, low=-1.0)

    def objective(raw):
        return (gc.gated(image, activations.activate(raw), radius=3) * upstream).sum()

    objective(raw).backward()
    step = 1e-6
    for channel in range(outputs):
        for row, column in [(0, 0), (3, 4), (2, 1)]:
            moved = torch.zeros_like(raw)
            moved[0, channel, row, column] = step
            with torch.no_grad():
                slope = (objective(raw + moved) - objective(raw - moved)) / (2 * step)
            assert math.isclose(
                raw.grad[0, channel, row, column], slope, rel_tol=FINITE_DIFFERENCE, abs_tol=FINITE_DIFFERENCE
            ), (channel, row, column)


def test_huge_bandwidths_leave_the_noisy_image():
    """Only the centre has a weight, so g_c = y_c."""
    image = random_features(8, 6, 7)
    parameters = activations.activate(random_raw(9, 6, 7))
    parameters[:, 9:14] = 1e4
    inside = gc.correct(image, parameters, radius=1)[:, :, 1:-1, 1:-1]
    assert torch.allclose(inside, image[:, 0:3, 1:-1, 1:-1], rtol=1e-9)


def test_mirrored_copies_of_the_centre_weigh_one():
    """In a 1x1 image every tap is the centre's mirror image: differences vanish, g_c = y."""
    image = random_features(10, 1, 1)
    parameters = activations.activate(random_raw(11, 1, 1))
    assert torch.allclose(gc.correct(image, parameters), image[:, 0:3], rtol=ROUNDING)


def test_equal_weights_give_the_mean():
    image = random_features(12, 5, 8)
    parameters = torch.zeros(1, 15, 5, 8, dtype=torch.float64)
    parameters[:, activations.TAU] = 1
    padded = gc.mirror_pad(image[:, 0:3], 2)
    mean = torch.nn.functional.avg_pool2d(padded, kernel_size=5, stride=1)
    assert torch.allclose(gc.correct(image, parameters, radius=2), mean, rtol=ROUNDING)


def test_unit_slope_on_the_denoised_image_is_f_c():
    image = random_features(13, 6, 6)
    parameters = activations.activate(random_raw(14, 6, 6))
    combined = gc.combine(image, parameters)
    parameters[:, 0:3] = 1
    parameters[:, 3:9] = 0
    assert torch.equal(combined, gc.correct(image, parameters))


def test_f_c_keeps_a_noise_free_residual():
    """With y = z everywhere, f_c = z_c whatever the weights: Deep Combiner's defining property."""
    image = random_features(15, 6, 6)
    image[:, features.CHANNELS["radiance"]] = image[:, features.CHANNELS["denoised"]]
    parameters = activations.activate(random_raw(16, 6, 6))
    combined = gc.combine(image, parameters)
    assert torch.allclose(combined, image[:, features.CHANNELS["denoised"]], rtol=1e-10)


def test_a_constant_in_albedo_or_normal_changes_nothing():
    image = random_features(17, 5, 5)
    shifted = image.clone()
    shifted[:, features.CHANNELS["albedo"]] += 0.25
    parameters = activations.activate(random_raw(18, 5, 5))
    a, b = gc.correct(image, parameters), gc.correct(shifted, parameters)
    assert torch.allclose(a, b, rtol=1e-10)


def test_borders_are_mirrored_with_the_edge_repeated():
    assert gc.mirrored_indices(4, 5).tolist() == [3, 3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0, 0]
    assert gc.mirrored_indices(1, 2).tolist() == [0] * 5
    image = random_features(19, 6, 6)
    raw = random_raw(20, 6, 6)
    flipped = gc.correct(image.flip(2, 3), activations.activate(raw.flip(2, 3)))
    assert torch.allclose(flipped.flip(2, 3), gc.correct(image, activations.activate(raw)), rtol=1e-10)


def test_the_gate_mixes_with_the_denoised_image():
    image = random_features(21, 4, 4)
    raw = random_raw(22, 4, 4, outputs=16)
    denoised = image[:, features.CHANNELS["denoised"]]
    corrected = gc.correct(image, activations.activate(raw))
    raw[:, 15] = -40.0
    assert torch.allclose(gc.gated(image, activations.activate(raw)), denoised, rtol=1e-10)
    raw[:, 15] = 40.0
    assert torch.allclose(gc.gated(image, activations.activate(raw)), corrected, rtol=1e-10)
    raw[:, 15] = activations.raw_gate(0.25)
    expected = 0.75 * denoised + 0.25 * corrected
    assert torch.allclose(gc.gated(image, activations.activate(raw)), expected, rtol=1e-10)


def test_bad_input_is_refused():
    image = random_features(23, 4, 4)
    parameters = activations.activate(random_raw(24, 4, 4))
    holed = image.clone()
    holed[0, 5, 2, 1] = math.nan
    with pytest.raises(features.BadInput, match=r"1 of 208 values .* \[0, 5, 2, 1\]"):
        gc.correct(holed, parameters)
    with pytest.raises(features.BadInput, match="parameters"):
        gc.correct(image, parameters * math.inf)
    with pytest.raises(ValueError, match="15 or 16"):
        gc.correct(image, parameters[:, :14])
    with pytest.raises(ValueError, match="size"):
        gc.correct(image, parameters[:, :, :3])
    with pytest.raises(features.BadInput, match="13"):
        gc.correct(image[:, :12], parameters)
