"""The corrected image, and relL2 against a reference."""

import torch

from . import activations, gc
from .features import CHANNELS, check_image
from .loss import EPSILON


def relative_l2(image, reference, reference_halves=None):
    """relL2 (Rousselle et al. 2011): mean over pixels and channels of (x - r)^2 / (rbar^2 + 0.01).

    rbar is the reference's channel mean. With the reference's two independent halves, whose mean
    then is r, its own noise ((r^a - r^b) / 2)^2 is subtracted from the numerator.
    """
    noise = 0
    if reference_halves is not None:
        half_a, half_b = reference_halves
        check_image("reference half a", half_a, 3)
        check_image("reference half b", half_b, 3)
        reference = (half_a + half_b) / 2
        noise = ((half_a - half_b) / 2).square()
    check_image("image", image, 3)
    check_image("reference", reference, 3)
    if image.shape != reference.shape:
        raise ValueError(f"image: expected {list(reference.shape)}, found {list(image.shape)}")
    error = (image - reference).square() - noise
    scale = reference.mean(dim=1, keepdim=True).square() + EPSILON
    return (error / scale).mean()


def corrected_halves(network, frame, radius=gc.RADIUS):
    """mu_hat^a and mu_hat^b of the whole image, [1, 3, H, W] each."""
    with torch.no_grad():
        return [gc.gated(half, activations.activate(network(half)), radius) for half in (frame.a, frame.b)]


def corrected_image(network, frame, radius=gc.RADIUS, weights=(0.5, 0.5)):
    """The paper's result: max(0, w_a mu_hat^a + w_b mu_hat^b), [1, 3, H, W]; w: the halves' shares of the samples."""
    a, b = corrected_halves(network, frame, radius)
    return (weights[0] * a + weights[1] * b).clamp_min(0)


def corrected_with_full_denoised(network, frame, radius=gc.RADIUS, weights=(0.5, 0.5)):
    """g_c with each half's parameters and radiance, but z and the features of the full buffer.

    The full buffer's features are the mean of both halves' by their weights; its z is `frame.denoised`.
    """
    full = weights[0] * frame.a + weights[1] * frame.b
    full[:, CHANNELS["denoised"]] = frame.denoised
    outputs = []
    with torch.no_grad():
        for half in (frame.a, frame.b):
            mixed = full.clone()
            mixed[:, CHANNELS["radiance"]] = half[:, CHANNELS["radiance"]]
            outputs.append(gc.gated(mixed, activations.activate(network(half)), radius))
    return (weights[0] * outputs[0] + weights[1] * outputs[1]).clamp_min(0)
