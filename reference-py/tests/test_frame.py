"""Reading, fitting, evaluating and comparing."""

import math

import numpy as np
import OpenEXR
import pytest
import torch
from samples import generator, random_features, uniform
from sspc_reference import compare, evaluate, features, fit, network, read
from sspc_reference.__main__ import main


def random_frame(seed, height, width):
    a, b = random_features(seed, height, width), random_features(seed + 50, height, width)
    for name in ("albedo", "visibility", "normal", "denoised"):
        b[:, features.CHANNELS[name]] = a[:, features.CHANNELS[name]]
    return read.Frame(a, b, features.part(a, "denoised"), [])


def write_half(path, half, drop=()):
    channels = {}
    for role, names in read.CHANNEL_NAMES.items():
        planes = features.part(half, role)[0].to(torch.float32).numpy()
        if role not in drop:
            channels.update((name, np.ascontiguousarray(p)) for name, p in zip(names, planes))
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))


@pytest.fixture
def files(tmp_path):
    frame = random_frame(1, 6, 9)
    write_half(tmp_path / "a.exr", frame.a)
    write_half(tmp_path / "b.exr", frame.b)
    read.write_image(tmp_path / "z.exr", frame.denoised)
    return tmp_path, frame


def test_a_frame_is_read_as_written(files):
    folder, frame = files
    found = read.read_frame(folder / "a.exr", folder / "b.exr", folder / "z.exr")
    assert torch.equal(found.a, frame.a.float()) and torch.equal(found.b, frame.b.float())
    assert torch.equal(found.denoised, frame.denoised.float()) and found.absent == []


def test_absent_features_are_zero_and_named(files):
    folder, frame = files
    for name, half in (("a", frame.a), ("b", frame.b)):
        write_half(folder / f"{name}.exr", half, drop=("visibility",))
    found = read.read_frame(folder / "a.exr", folder / "b.exr")
    assert found.absent == ["visibility"]
    assert features.part(found.a, "visibility").abs().max() == 0


def test_bad_files_are_refused(files):
    folder, frame = files
    with pytest.raises(read.BadInput, match="no such file"):
        read.read_frame(folder / "a.exr", folder / "c.exr")
    with pytest.raises(read.BadInput, match="identical"):
        read.read_frame(folder / "a.exr", folder / "a.exr")
    with pytest.raises(read.BadInput, match=r"z.exr: no channel denoised.R; it has B, G, R"):
        read.read_frame(folder / "z.exr", folder / "b.exr")
    write_half(folder / "small.exr", frame.b[:, :, :, 1:])
    with pytest.raises(read.BadInput, match=r"small.exr: expected 6x9 .* found 6x8"):
        read.read_frame(folder / "a.exr", folder / "small.exr")
    frame.b[0, 4, 2, 3] = math.nan
    write_half(folder / "nan.exr", frame.b)
    with pytest.raises(read.BadInput, match=r"nan.exr: albedo: 1 of 162 values"):
        read.read_frame(folder / "a.exr", folder / "nan.exr")


def test_origins_cover_every_pixel():
    assert fit.origins(360, 128, 64) == [0, 64, 128, 192, 232]
    assert fit.origins(100, 128, 64) == [0]
    assert fit.origins(128, 128, 64) == [0]


def test_a_tile_with_its_halo_is_a_part_of_the_whole():
    frame = random_frame(2, 17, 14)
    net = network.Network(16).double()
    network.near_denoised_start(net, generator(1))
    radius, halo, whole = 2, fit.NETWORK_RADIUS, [fit.Tile(0, 0, 17, 14)]
    parts = [fit.Tile(0, 0, 5, 14), fit.Tile(5, 0, 12, 3), fit.Tile(5, 3, 1, 11), fit.Tile(6, 3, 11, 11)]
    expected = fit.step_gradient(net, frame, whole, halo=0, radius=radius)
    gradient = net.flat_gradient()
    found = fit.step_gradient(net, frame, parts, halo, radius)
    assert math.isclose(found, expected, rel_tol=1e-12)
    assert torch.allclose(net.flat_gradient(), gradient, rtol=1e-9, atol=1e-12)
    # One pixel less of halo must show, or the test could not fail.
    short = fit.step_gradient(net, frame, parts, halo - 1, radius)
    assert abs(short - expected) > 1e-9 * expected


def test_weight_gradients_are_finite_differences():
    frame = random_frame(3, 5, 6)
    net = network.Network(16).double()
    network.near_denoised_start(net, generator(2))
    tiles = [fit.Tile(0, 0, 5, 6)]
    fit.step_gradient(net, frame, tiles, 0, radius=2)
    gradient, weights = net.flat_gradient(), net.flat()
    for index in [0, 1871, 1872, 9000, 18150, 20440, 20447]:
        sides = []
        for sign in (1, -1):
            moved = weights.clone()
            moved[index] += sign * 1e-6
            net.load_flat(moved)
            sides.append(fit.step_gradient(net, frame, tiles, 0, radius=2))
        slope = (sides[0] - sides[1]) / 2e-6
        assert math.isclose(gradient[index], slope, rel_tol=1e-5, abs_tol=1e-8), index


def test_fitting_lowers_the_loss_and_repeats_itself():
    frame = random_frame(4, 12, 12)

    def losses():
        net = network.Network(16).double()
        network.near_denoised_start(net, generator(3))
        schedule = fit.tile_schedule(frame, 5, steps=6, size=8, batch=2)
        before = fit.step_gradient(net, frame, [fit.Tile(0, 0, 12, 12)], 0, radius=2)
        steps = fit.fit(net, frame, schedule, radius=2)
        return before, steps, fit.step_gradient(net, frame, [fit.Tile(0, 0, 12, 12)], 0, radius=2)

    before, steps, after = losses()
    assert after < before
    assert losses() == (before, steps, after)


def test_paper_schedule_visits_every_patch_once_an_epoch():
    frame = random_frame(5, 12, 16)
    schedule = fit.paper_schedule(frame, 1, epochs=2, size=8, stride=4, batch=4)
    assert [len(step.tiles) for step in schedule.steps] == [4, 2] * 2
    tiles = [tile for step in schedule.steps[:2] for tile in step.tiles]
    assert len(set(tiles)) == 6 and schedule.halo == 0
    difference = features.part(frame.a, "radiance") - features.part(frame.b, "radiance")
    expected = 0.01 * math.sqrt((difference / 2).square().mean())
    assert math.isclose(schedule.steps[0].rate, expected, rel_tol=1e-12)


def test_relative_l2_takes_the_references_noise_out():
    halves = [torch.full((1, 3, 2, 2), value, dtype=torch.float64) for value in (0.4, 0.6)]
    image = torch.full((1, 3, 2, 2), 0.8, dtype=torch.float64)
    mean = torch.full((1, 3, 2, 2), 0.5, dtype=torch.float64)
    assert math.isclose(evaluate.relative_l2(image, mean), 0.09 / 0.26)
    assert math.isclose(evaluate.relative_l2(image, mean, halves), (0.09 - 0.01) / 0.26)
    with pytest.raises(ValueError, match="image: expected"):
        evaluate.relative_l2(image[:, :, :1], mean)
    with pytest.raises(features.BadInput, match="reference"):
        evaluate.relative_l2(image, mean * math.nan)


def test_full_z_is_the_halves_when_both_are_one():
    frame = random_frame(6, 8, 8)
    frame.b = frame.a.clone()
    net = network.Network(16).double()
    network.near_denoised_start(net, generator(4))
    halves = evaluate.corrected_image(net, frame)
    assert torch.allclose(evaluate.corrected_with_full_denoised(net, frame), halves, rtol=1e-12)


def test_compare_names_the_first_difference(tmp_path):
    expected = {
        "features": uniform(1, 13, 3, 4).numpy(),
        "layer_1": uniform(2, 16, 3, 4).numpy(),
        "layer_2": uniform(3, 16, 3, 4).numpy(),
        "g": uniform(4, 3, 3, 4).numpy(),
    }
    same = compare.first_difference(expected, expected)
    assert not same.differs and "layer_2: equal" in same.text
    found = {name: array.copy() for name, array in expected.items()}
    found["layer_2"][3, 1, 2] += 0.5
    found["layer_2"][7, 2, 0] = math.nan
    found["g"][:] = 0
    report = compare.first_difference(expected, found)
    assert report.differs and "layer_2: FIRST DIFFERENCE, 2 of 192 values" in report.text
    assert "first at (3, 1, 2)" in report.text and "worst at (7, 2, 0)" in report.text
    compare.write_error_map(tmp_path / "error.png", report.error)
    assert (tmp_path / "error.png").read_bytes().startswith(b"\x89PNG")
    found["features"] = found["features"][:12]
    assert "features: FIRST DIFFERENCE, shape" in compare.first_difference(expected, found).text


def test_compare_names_the_layer_of_a_gradient():
    gradient = {"d_weights": uniform(1, 20448).numpy()}
    for layer, index in [(1, 1887), (2, 1888), (8, 18127), (9, 18128), (9, 20447)]:
        found = gradient["d_weights"].copy()
        found[index] += 1
        text = compare.first_difference(gradient, {"d_weights": found}).text
        assert f"d_weights of layer {layer}: FIRST DIFFERENCE" in text


def test_command_line_fits_and_evaluates(files, capsys):
    folder, _ = files
    a, b, z, w = (str(folder / name) for name in ("a.exr", "b.exr", "z.exr", "w.npy"))
    out = str(folder / "out.exr")
    arguments = ["fit", a, b, "--denoised", z, "--steps", "1", "--gate", "--weights", w]
    assert main([*arguments, "--reference", z, "-o", out]) == 0
    fitted = capsys.readouterr().out
    assert '"image": "denoised", "relL2": 0.0' in fitted
    assert main(["evaluate", a, b, "--denoised", z, "--weights", w, "--reference", z]) == 0
    assert capsys.readouterr().out == fitted
    assert main(["time", a, b, "--steps", "1"]) == 0
    assert '"steps": 1' in capsys.readouterr().out
    assert main(["evaluate", a, a, "--weights", w, "--reference", z]) == 1
    assert "identical" in capsys.readouterr().err
