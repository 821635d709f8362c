"""The network, the loss, relL2, and the whole pipeline stage by stage."""

import numpy as np
import torch
from sspc_reference import activations, differences, evaluate, features, gc, loss, network

from .case import Case, Inputs, double, short, stack


def weights(random, outputs):
    """Flat weights as after some training: Glorot-sized kernels, small biases; float32."""
    net = network.Network(outputs)
    parts = []
    for layer in net.layers:
        fan_in, fan_out = layer.weight.shape[1] * 9, layer.weight.shape[0] * 9
        bound = np.sqrt(6 / (fan_in + fan_out))
        parts.append(random.uniform(layer.weight.numel(), low=-bound, high=bound))
        parts.append(random.normal(layer.bias.numel(), scale=0.05))
    return short(np.concatenate(parts))


def double_network(flat, outputs):
    net = network.Network(outputs).double()
    net.load_flat(torch.from_numpy(flat).double())
    return net


def network_case():
    random = Inputs(41)
    flat = weights(random, 15)
    sizes = [(1, 1), (1, 6), (7, 5), (11, 13)]
    case = Case(
        "network",
        "The network's raw outputs and weight gradients on sizes from 1x1 to beyond one tile row.",
        {"kind": "network", "outputs": 15, "sizes": [f"{h}x{w}" for h, w in sizes]},
    )
    case.put(weights=flat)
    net = double_network(flat, 15)
    net.zero_grad()
    for height, width in sizes:
        size = f"{height}x{width}"
        image = stack(random.buffer(height, width))
        upstream = random.normal(15, height, width)
        raw = net(double(image))
        (raw * double(upstream)).sum().backward()
        case.put(**{f"features_{size}": image, f"upstream_{size}": upstream, f"raw_{size}": raw[0]})
    # The sum over all sizes: every size's gradient counts, and one array is stored.
    case.put(d_weights=net.flat_gradient().float())
    return case


def loss_case(name, purpose, seed, height, width, hdr=False):
    random = Inputs(seed)
    case = Case(name, purpose, {"kind": "loss"})

    def image():
        if hdr:
            return random.log_uniform(3, height, width, low=1e-6, high=1e5)
        return random.uniform(3, height, width, high=2.0)

    names = ["mu_hat_a", "mu_hat_b", "noisy_a", "noisy_b", "denoised_a", "denoised_b"]
    images = {name: image() for name in names}
    case.put(**images)
    noisy = [double(images[n]) for n in ("noisy_a", "noisy_b")]
    denoised = [double(images[n]) for n in ("denoised_a", "denoised_b")]
    for guide, guides in (("denoised", denoised), ("noisy", noisy)):
        outputs = [double(images[n]).requires_grad_() for n in ("mu_hat_a", "mu_hat_b")]
        value = loss.loss(*outputs, *noisy, *guides)
        value.backward()
        case.put(
            **{
                f"loss_over_{guide}": value.reshape(1),
                f"d_mu_hat_a_over_{guide}": outputs[0].grad[0],
                f"d_mu_hat_b_over_{guide}": outputs[1].grad[0],
            }
        )
    return case


def differences_case(name, seed, height, width):
    random = Inputs(seed)
    case = Case(
        name,
        "Colours and differences of one half's correction, their weights, and the gradient with and without a limit.",
        {"kind": "differences", "influence": 1.5},
    )
    given = {f"noisy_{half}": random.uniform(3, height, width, high=2.0) for half in "ab"}
    given |= {f"given_{half}": random.normal(6, height, width, scale=0.3) for half in "ab"}
    given |= {"mu_hat": random.uniform(3, height, width, high=2.0), "weight": random.uniform(1, height, width)}
    case.put(**given)
    images = {key: double(values) for key, values in given.items()}
    of_differences = differences.weights(
        *(images[key] for key in ("noisy_a", "noisy_b", "given_a", "given_b", "weight"))
    )
    case.put(difference_weight=of_differences[0])
    for suffix, influence in (("", float("inf")), ("_limited", case.facts["influence"])):
        output = images["mu_hat"].clone().requires_grad_()
        judged = images["noisy_b"], images["weight"], images["given_b"], of_differences
        value = differences.half_loss(output, *judged, influence)
        value.backward()
        case.put(**{f"loss{suffix}": value.reshape(1), f"d_mu_hat{suffix}": output.grad[0]})
    return case


def relative_l2_case(name, purpose, seed, height, width, low, high):
    random = Inputs(seed)
    case = Case(name, purpose, {"kind": "relative_l2"})
    truth = random.log_uniform(3, height, width, low=low, high=high)
    noisy = [truth * random.uniform(3, height, width, low=0.8, high=1.2) for _ in range(3)]
    image, half_a, half_b = (array.astype(np.float32) for array in noisy)
    reference = ((half_a.astype(np.float64) + half_b) / 2).astype(np.float32)
    case.put(
        image=image,
        reference=reference,
        reference_a=half_a,
        reference_b=half_b,
        relative_l2=evaluate.relative_l2(double(image), double(reference)).reshape(1),
        relative_l2_halves=evaluate.relative_l2(double(image), None, [double(half_a), double(half_b)]).reshape(1),
    )
    return case


def pipeline_case():
    """Both halves of a frame through every stage and back; index 0 of each array is half a."""
    random = Inputs(51)
    height, width = 7, 6
    case = Case(
        "pipeline",
        "Every stage of one step, forward and backward, to name the first one that differs.",
        {"kind": "pipeline", "radius": 9, "outputs": 16},
    )
    halves = [random.buffer(height, width) for _ in "ab"]
    flat = weights(random, 16)
    case.put(weights=flat, **{role: np.stack([half[role] for half in halves]) for role in features.CHANNELS})
    image = torch.cat([features.assemble(**{role: double(plane) for role, plane in half.items()}) for half in halves])
    net = double_network(flat, 16)
    stages = net.stages(image)
    raw = stages[-1]
    parameters = activations.activate(raw)
    mu_hat = gc.gated(image, parameters)
    for tensor in (raw, parameters, mu_hat):
        tensor.retain_grad()
    noisy, denoised = features.part(image, "radiance"), features.part(image, "denoised")
    value = loss.loss(*mu_hat.split(1), *noisy.split(1), *denoised.split(1))
    value.backward()
    case.put(
        features=image.float(),
        **{f"layer_{index + 1}": stage.float() for index, stage in enumerate(stages[:-1])},
        layer_9=raw,
        parameters=parameters,
        g=gc.correct(image, parameters),
        mu_hat=mu_hat,
        loss=value.reshape(1),
        d_mu_hat=mu_hat.grad,
        d_parameters=parameters.grad,
        d_raw=raw.grad,
        d_weights=net.flat_gradient().float(),
    )
    return case


def cases():
    return [
        network_case(),
        loss_case("loss", "The loss over both denominators, and its gradients.", 42, 9, 7),
        loss_case("loss-1x1", "The loss of one pixel.", 43, 1, 1),
        loss_case("loss-hdr", "The loss of values from 1e-6 to 1e5.", 44, 7, 8, hdr=True),
        differences_case("differences", 48, 9, 21),
        differences_case("differences-1x5", 49, 1, 5),
        relative_l2_case("relative-l2", "relL2 with and without halves.", 45, 9, 7, 0.05, 2),
        relative_l2_case("relative-l2-1x1", "relL2 of one pixel.", 46, 1, 1, 0.05, 2),
        relative_l2_case("relative-l2-hdr", "relL2 of values from 1e-6 to 1e5.", 47, 8, 9, 1e-6, 1e5),
        pipeline_case(),
    ]
