"""Arrays of every kind give the same picture, in the kind that they came in."""

import array
import warnings

import numpy as np
import pytest
from conftest import make_frame, same_bits

import sspc


@pytest.fixture(scope="module")
def torch():
    return pytest.importorskip("torch", reason="PyTorch is not installed: its tensors are not tried")


def test_results_are_float32_of_the_frame_s_size(frame, model):
    result = model.correct(**frame)
    assert result.picture.shape == (40, 56, 3) and result.picture.dtype == np.float32
    assert result.share.shape == (40, 56) and result.share.dtype == np.float32
    assert 0 <= result.share.min() <= result.share.max() <= 1
    assert result.picture.flags.writeable


def test_strides_and_byte_order_do_not_matter(frame, model):
    expected = model.correct(**frame).picture
    planar = {name: np.ascontiguousarray(np.moveaxis(a, -1, 0)) for name, a in frame.items() if a.ndim == 3}
    turned = {name: np.moveaxis(a, 0, -1) for name, a in planar.items()}
    assert not turned["a"].flags.c_contiguous
    assert same_bits(model.correct(**(frame | turned)).picture, expected)
    flipped = {name: np.ascontiguousarray(a[::-1, ::-1])[::-1, ::-1] for name, a in frame.items()}
    assert flipped["a"].strides[0] < 0
    assert same_bits(model.correct(**flipped).picture, expected)
    padded = {name: np.concatenate([a, a], axis=-1)[..., :3] for name, a in frame.items() if a.ndim == 3}
    assert same_bits(model.correct(**(frame | padded)).picture, expected)
    swapped = {name: a.astype(">f4") for name, a in frame.items()}
    assert same_bits(model.correct(**swapped).picture, expected)
    read_only = {name: np.frombuffer(a.tobytes(), np.float32).reshape(a.shape) for name, a in frame.items()}
    assert same_bits(model.correct(**read_only).picture, expected)


def test_half_floats_are_the_floats_of_their_values(frame, model):
    halves = {name: a.astype(np.float16) for name, a in frame.items()}
    floats = {name: a.astype(np.float32) for name, a in halves.items()}
    assert same_bits(model.correct(**halves).picture, model.correct(**floats).picture)


def test_visibility_may_have_a_channel_axis(frame, model):
    with_axis = {name: frame[name][..., None] for name in ("visibility_a", "visibility_b")}
    assert same_bits(model.correct(**(frame | with_axis)).picture, model.correct(**frame).picture)


def test_inputs_are_not_changed(frame, model):
    before = {name: a.copy() for name, a in frame.items()}
    model.correct(**frame)
    sspc.fit(**frame, steps=1)
    assert all(same_bits(frame[name], before[name]) for name in frame)


def test_memory_views_give_memory_views(frame, model):
    views = {name: memoryview(a) for name, a in frame.items()}
    result = model.correct(**views)
    assert isinstance(result.picture, memoryview) and result.picture.shape == (40, 56, 3)
    assert same_bits(np.asarray(result.picture), model.correct(**frame).picture)


class OnlyDlpack:
    """An array that another library may have: DLPack and the array API's namespace, no buffer protocol."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()

    def __array_namespace__(self):
        return OnlyDlpack

    @staticmethod
    def asarray(array):
        return OnlyDlpack(array)


def test_dlpack_and_the_array_api(frame, model):
    result = model.correct(**{name: OnlyDlpack(a) for name, a in frame.items()})
    assert isinstance(result.picture, OnlyDlpack) and isinstance(result.share, OnlyDlpack)
    assert same_bits(result.picture.array, model.correct(**frame).picture)


def test_torch_tensors_give_torch_tensors(frame, model, torch):
    expected = model.correct(**frame)
    tensors = {name: torch.from_numpy(a) for name, a in frame.items()}
    result = model.correct(**tensors)
    assert isinstance(result.picture, torch.Tensor) and result.share.shape == (40, 56)
    assert same_bits(result.picture.numpy(), expected.picture) and same_bits(result.share.numpy(), expected.share)
    planar = {name: t.permute(2, 0, 1).contiguous().permute(1, 2, 0) for name, t in tensors.items() if t.ndim == 3}
    assert same_bits(model.correct(**(tensors | planar)).picture.numpy(), expected.picture)
    fitted = sspc.fit(**tensors, steps=2).correct(**tensors)
    assert same_bits(fitted.picture.numpy(), sspc.fit(**frame, steps=2).correct(**frame).picture)
    halves = {name: t.half() for name, t in tensors.items()}
    assert same_bits(
        model.correct(**halves).picture.numpy(),
        model.correct(**{name: t.half().numpy() for name, t in tensors.items()}).picture,
    )


def test_torch_tensors_that_cannot_be_read(frame, model, torch):
    for tensor, text in [
        (torch.from_numpy(frame["a"]).requires_grad_(), "gradient"),
        (torch.from_numpy(frame["a"]).bfloat16(), "a: "),
    ]:
        with pytest.raises(sspc.Error, match=text) as caught:
            model.correct(**(frame | {"a": tensor}))
        assert caught.value.code == 3 and "float16" in caught.value.advice


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("a", lambda a: a.astype(np.float64), r"^a: expected float32 or float16, found float64$"),
        ("b", lambda a: (255 * a).astype(np.uint8), r"^b: expected float32 or float16, found uint8$"),
        ("denoised_a", lambda a: a[..., 0], r"^denoised_a: .*shape \(height, width, 3\), found \(40, 56\)$"),
        ("denoised", lambda a: np.moveaxis(a, -1, 0), r"^denoised: .*found \(3, 40, 56\)$"),
        ("albedo_a", lambda a: np.concatenate([a, a[..., :1]], -1), r"^albedo_a: .*found \(40, 56, 4\)$"),
        ("visibility_b", lambda a: a[..., None].repeat(3, -1), r"\(height, width, 1\) or \(height, width\), found"),
        ("a", lambda a: a[:0], r"^a: .*found \(0, 56, 3\)$"),
        ("normal_b", lambda a: a[1:], r"^normal_b: expected 56 x 40 pixels as in a, found 56 x 39$"),
        ("a", lambda a: a.tolist(), r"^a: expected an array, found list$"),
        ("denoised_b", lambda a: "denoised.exr", r"^denoised_b: expected an array, found str$"),
        ("b", lambda a: None, r"^b: expected an array, found NoneType$"),
        ("a", lambda a: array.array("f", [1.0]), r"^a: .*found \(1,\)$"),
    ],
)
def test_bad_arrays_are_named_with_what_was_expected_and_found(name, change, text, frame, model):
    wrong = frame | {name: change(frame[name])}
    for call in (model.correct, lambda **arrays: sspc.fit(**arrays, steps=1)):
        with pytest.raises(sspc.Error, match=text.rstrip("$")) as caught:
            call(**wrong)
        assert caught.value.code == 3 and caught.value.advice and str(caught.value).endswith(caught.value.advice)


def test_a_feature_of_one_half_is_left_out_aloud(model):
    frame = make_frame()
    del frame["albedo_b"]
    with pytest.warns(sspc.FrameWarning, match=r"albedo: only half a has it \(albedo_a\), so it is not used") as seen:
        result = model.correct(**frame)
    assert all(warning.filename == __file__ for warning in seen)
    del frame["albedo_a"]
    assert same_bits(result.picture, model.correct(**frame).picture)


def test_what_a_person_should_know_is_a_warning(frame):
    few = {name: frame[name] for name in ("a", "b", "denoised_a", "denoised_b")}
    with pytest.warns(sspc.FrameWarning, match="no denoised full buffer"):
        sspc.fit(**few, steps=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sspc.fit(**frame, steps=1)


def test_further_denoised_pictures_are_checked(frame, model):
    a, b = frame["denoised_a"], frame["denoised_b"]
    pair = r"denoised_more\[1\]: expected \(half a, half b\) or \(half a, half b, full buffer\), found "
    cases = {
        pair + "ndarray": a,
        pair + "1 arrays": (a,),
        r"denoised_more\[1\]\[2\]: expected 56 x 40 pixels as in a, found 56 x 1": (a, b, a[:1]),
        r"denoised_more\[1\]\[0\]: expected an array, found NoneType": (None, b),
    }
    for message, pictures in cases.items():
        with pytest.raises(sspc.Error, match=message) as caught:
            model.correct(**frame, denoised_more=[(a, b), pictures])
        assert caught.value.code == 3
