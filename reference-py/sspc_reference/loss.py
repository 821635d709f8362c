"""The self-supervised loss (paper Eqs. 8, 9): each half's output against the noisy image of the other half."""

import torch

from .features import check_image

EPSILON = 0.01


def denominator(image):
    """(channel mean)^2 + 0.01 per pixel: [B, 3, H, W] -> [B, 1, H, W]."""
    return image.mean(dim=1, keepdim=True).square() + EPSILON


def half_loss(output, other_noisy, other_guide):
    """L(mu_hat^a) of every pixel, ||mu_hat^a - y^b||^2 / ((mean of guide^b)^2 + 0.01): [B, 1, H, W].

    The guide must be independent of mu_hat^a. The paper takes z^b; y^b is its noisier alternative.
    """
    error = (output - other_noisy).square().sum(dim=1, keepdim=True)
    return error / denominator(other_guide)


def pixel_loss(output_a, output_b, noisy_a, noisy_b, guide_a, guide_b):
    """1/3 * 1/2 (L(mu_hat^a) + L(mu_hat^b)) of every pixel, [B, 1, H, W]; Eq. 9 is its mean."""
    images = {
        "output a": output_a,
        "output b": output_b,
        "noisy a": noisy_a,
        "noisy b": noisy_b,
        "guide a": guide_a,
        "guide b": guide_b,
    }
    for name, image in images.items():
        check_image(name, image, 3)
        if image.shape != output_a.shape:
            raise ValueError(f"{name}: expected {list(output_a.shape)}, found {list(image.shape)}")
    loss_a = half_loss(output_a, noisy_b, guide_b)
    loss_b = half_loss(output_b, noisy_a, guide_a)
    return (loss_a + loss_b) / 6


def loss(output_a, output_b, noisy_a, noisy_b, guide_a, guide_b):
    """Eq. 9: the mean over pixels, channels and both halves; a scalar."""
    return pixel_loss(output_a, output_b, noisy_a, noisy_b, guide_a, guide_b).mean()


def improvement(output_a, output_b, noisy_a, noisy_b, denoised_a, denoised_b):
    """Estimate of how much larger the denoiser's error is than ours, per pixel [B, 1, H, W].

    The loss of z minus the loss of mu_hat, unbiased without any variance estimate: the variance of
    the other half's noisy image is the same in both and cancels. (It compares the halves' outputs;
    their mean is better than either.)
    """
    with torch.no_grad():
        ours = pixel_loss(output_a, output_b, noisy_a, noisy_b, denoised_a, denoised_b)
        theirs = pixel_loss(denoised_a, denoised_b, noisy_a, noisy_b, denoised_a, denoised_b)
        return theirs - ours
