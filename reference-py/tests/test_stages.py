"""Features, network, activations and loss: shapes, orders, constants, refusals."""

import math

import pytest
import torch
from samples import generator, random_features, random_raw, uniform
from sspc_reference import activations, features, loss, network


def image(seed, channels=3, height=4, width=5, low=0.0):
    return uniform(seed, 1, channels, height, width, low=low)


def test_features_stand_in_the_papers_order():
    stack = features.assemble(
        radiance=torch.full((1, 3, 2, 2), 1.0),
        denoised=torch.full((1, 3, 2, 2), 5.0),
        albedo=torch.full((1, 3, 2, 2), 2.0),
        visibility=torch.full((1, 1, 2, 2), 3.0),
        normal=torch.full((1, 3, 2, 2), 4.0),
    )
    assert stack[0, :, 0, 0].tolist() == [1, 1, 1, 2, 2, 2, 3, 4, 4, 4, 5, 5, 5]


def test_colours_are_clamped_and_normals_are_not():
    stack = features.assemble(image(1, low=-1), image(2, low=-1), normal=image(3, low=-1))
    assert -1 <= features.part(stack, "radiance").min() < 0
    assert features.part(stack, "denoised").min() == 0
    assert features.part(stack, "normal").min() < 0
    deep = features.assemble(20 * image(1, low=-1), image(2))
    assert features.part(deep, "radiance").min() == -10
    assert features.part(stack, "albedo").abs().max() == 0


def test_features_refuse_bad_images():
    with pytest.raises(features.BadInput, match=r"albedo: expected 4x5 .* found 4x6"):
        features.assemble(image(1), image(2), albedo=image(3, width=6))
    with pytest.raises(features.BadInput, match=r"visibility: expected \[B, 1, H, W\]"):
        features.assemble(image(1), image(2), visibility=image(3))
    with pytest.raises(features.BadInput, match="denoised: .* NaN"):
        features.assemble(image(1), image(2) * math.nan)
    with pytest.raises(features.BadInput, match="radiance"):
        features.assemble(torch.zeros(1, 3, 0, 4), torch.zeros(1, 3, 0, 4))


@pytest.mark.parametrize(("outputs", "weights"), [(15, 20303), (16, 20448)])
def test_network_size(outputs, weights):
    net = network.Network(outputs)
    assert net.flat().shape == (weights,)
    for height, width in [(1, 1), (3, 8)]:
        assert net.double()(random_features(1, height, width)).shape == (1, outputs, height, width)


def test_network_sees_nine_pixels_and_zeros_beyond_the_border():
    net = network.Network().double()
    network.uniform_start(net, generator(1))
    wide = random_features(2, 1, 24)
    changed = wide.clone()
    changed[:, :, :, 20] += 1
    differs = (net(wide) - net(changed)).abs().amax(dim=(0, 1, 2)) > 0
    assert differs.tolist() == [column >= 11 for column in range(24)]


def test_flat_weights_come_back():
    net = network.Network()
    vector = torch.arange(20303.0)
    net.load_flat(vector)
    assert torch.equal(net.flat(), vector)
    # The first layer's weight [16][13][3][3], then its bias, then the second layer.
    assert net.layers[0].weight[2, 5, 1, 0] == ((2 * 13 + 5) * 3 + 1) * 3
    assert net.layers[0].bias[0] == 16 * 13 * 9
    assert net.layers[1].weight[0, 0, 0, 0] == 16 * 13 * 9 + 16
    with pytest.raises(ValueError, match=r"expected \[20303\], found \[20302\]"):
        net.load_flat(vector[1:])
    with pytest.raises(ValueError, match="NaN"):
        net.load_flat(vector * math.nan)


def test_network_refuses_nan():
    with pytest.raises(features.BadInput, match="features"):
        network.Network()(torch.full((1, 13, 3, 3), math.nan))


def test_near_denoised_start_activates_to_its_parameters():
    net = network.Network(16).double()
    network.near_denoised_start(net, generator(1))
    with torch.no_grad():
        net.layers[-1].weight.zero_()
    found = activations.activate(net(random_features(2, 2, 2)))[0, :, 0, 0]
    expected = [0.9] * 3 + [0] * 6 + [30, 4, 1, 0.5, 5, 1, 0.5]
    assert torch.allclose(found, torch.tensor(expected, dtype=torch.float64), rtol=1e-6)


def test_activations_at_the_extremes():
    low = activations.activate(torch.full((1, 16, 1, 1), -40.0, dtype=torch.float64)).flatten()
    high = activations.activate(torch.full((1, 16, 1, 1), 40.0, dtype=torch.float64)).flatten()
    assert torch.equal(low[:9], -torch.ones(9, dtype=torch.float64))
    assert torch.allclose(low[9:14], torch.tensor(1e4, dtype=torch.float64))
    assert math.isclose(low[14], 1e-4) and math.isclose(low[15], math.exp(-40), rel_tol=1e-12)
    assert torch.allclose(high[9:14], torch.tensor(1 / 1600.0001, dtype=torch.float64))
    assert math.isclose(high[14], 40.0001) and high[15] == 1
    raw = torch.tensor([-40.0, 0.0, 40.0], dtype=torch.float64)
    assert torch.allclose(activations.softplus(raw), torch.log1p(raw.exp()), rtol=1e-12)


def test_activations_refuse_other_channel_counts():
    with pytest.raises(ValueError, match="15 or 16"):
        activations.activate(random_raw(1, 2, 2, outputs=14))


def test_loss_is_equation_9():
    mu_a, mu_b, y_a, y_b, z_a, z_b = (image(seed)[0] for seed in range(6))
    total = 0.0
    for row in range(4):
        for column in range(5):
            at = (slice(None), row, column)
            for mu, y, z in [(mu_a, y_b, z_b), (mu_b, y_a, z_a)]:
                d = mu[at] - y[at]
                total += 0.5 * (d @ d) / (z[at].mean() ** 2 + 0.01)
    expected = total / (3 * 4 * 5)
    found = loss.loss(*(values[None] for values in (mu_a, mu_b, y_a, y_b, z_a, z_b)))
    assert math.isclose(found, expected, rel_tol=1e-12)


def test_improvement_is_positive_where_the_output_is_better():
    """Many pixels, so the estimate's own noise (the other half's) averages out."""
    truth = image(1, height=64, width=64)
    noisy = [truth + 0.2 * image(seed, height=64, width=64, low=-1) for seed in (2, 3)]
    worse = [truth + 0.1] * 2
    better = [truth + 0.01] * 2
    gain = loss.improvement(*better, *noisy, *worse).mean()
    scale = (1 / loss.denominator(truth + 0.1)).mean()
    assert math.isclose(gain, (0.1**2 - 0.01**2) * scale, rel_tol=0.1)


def test_loss_refuses_bad_images():
    good = [image(seed) for seed in range(6)]
    with pytest.raises(features.BadInput, match="noisy a"):
        loss.loss(*good[:2], good[2] * math.nan, *good[3:])
    with pytest.raises(ValueError, match="guide b: expected"):
        loss.loss(*good[:5], image(6, width=4))
