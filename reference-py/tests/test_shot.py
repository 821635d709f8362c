"""The temporal mean: what must hold by algebra."""

import torch
from sspc_reference import shot


def image(channels, height, width, seed=0):
    return torch.rand(1, channels, height, width, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def constant_field(right, down, height, width):
    return torch.tensor([right, down], dtype=torch.float64)[None, :, None, None].expand(1, 2, height, width).clone()


def test_whole_pixels_are_copied_by_both_kernels():
    picture = image(3, 5, 7)
    for weights in (shot.bilinear_weights, shot.cubic_weights):
        warped, inside = shot.warp(picture, constant_field(2.0, -1.0, 5, 7), weights)
        assert torch.allclose(warped[:, :, 1:, :5], picture[:, :, :-1, 2:])
        assert inside.sum() == 4 * 5 and not inside[0].any()


def test_a_ramp_is_kept_between_pixels():
    ramp = torch.arange(9, dtype=torch.float64).expand(1, 1, 6, 9)
    for weights in (shot.bilinear_weights, shot.cubic_weights):
        warped, _ = shot.warp(ramp, constant_field(0.3, 0.6, 6, 9), weights)
        assert torch.allclose(warped[..., 1:7], ramp[..., 1:7] + 0.3)


def test_the_mean_of_neighbours_that_show_the_same_is_the_plain_mean():
    z, other, still = image(3, 4, 4), image(3, 4, 4, 1), constant_field(0.0, 0.0, 4, 4)
    features = {"albedo": image(3, 4, 4, 2), "normal": image(3, 4, 4, 3)}
    valid = shot.validity(features, features, still)
    assert torch.equal(valid, torch.ones_like(valid))
    assert torch.allclose(shot.temporal_mean(z, [(other, still, valid)] * 2), (z + 2 * other) / 3)


def test_other_features_and_places_outside_count_less():
    still, features = constant_field(0.0, 0.0, 4, 4), {"albedo": torch.zeros(1, 3, 4, 4, dtype=torch.float64)}
    other = {"albedo": torch.full((1, 3, 4, 4), 0.5, dtype=torch.float64)}
    valid = shot.validity(features, other, still)
    assert torch.allclose(valid, torch.exp(torch.tensor(-0.3 * 8 * 0.75, dtype=torch.float64)))
    assert shot.validity(features, other, constant_field(4.0, 0.0, 4, 4)).sum() == 0


def test_light_that_changes_counts_less_and_flicker_does_not():
    still, one = constant_field(0.0, 0.0, 8, 8), torch.ones(1, 3, 8, 8, dtype=torch.float64)

    def left(a, b):
        return shot.same_light(one, a * one, (a * one, b * one), still)[0, 0, 4, 4].item()

    assert left(1.15, 1.15) == 1
    assert left(2.5, 2.5) == 0
    assert abs(left(0.65, 0.65) - 0.5) < 1e-9
    assert left(0.5, 0.75) == 1
