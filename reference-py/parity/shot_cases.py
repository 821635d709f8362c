"""Warp, validity and temporal mean of a shot's frame."""

import numpy as np
from sspc_reference import shot

from .case import Case, Inputs, double


def shot_case():
    random = Inputs(61)
    sizes = [(1, 1), (1, 6), (7, 1), (9, 13)]
    case = Case(
        "shot",
        "Warp by both kernels, validity by features and by light, temporal mean over two neighbours: "
        "borders, whole pixels, places outside.",
        {"kind": "shot", "sizes": [f"{h}x{w}" for h, w in sizes]},
    )
    for height, width in sizes:
        size = f"{height}x{width}"
        own = random.buffer(height, width)
        case.put(**{f"{role}_{size}": own[role] for role in ("denoised", "albedo", "normal")})
        # Halves differ little, so that light counts.
        other_half = like(random, own["denoised"])
        case.put(**{f"denoised_of_b_{size}": other_half})
        neighbours = []
        for k in (0, 1):
            other = random.buffer(height, width)
            of_b = like(random, other["denoised"])
            field = random.uniform(2, height, width, low=-2.5, high=2.5)
            field[:, ::3, ::2] = np.round(field[:, ::3, ::2])
            field[:, 0, 0] = 0
            field[0, height - 1, width - 1] = -(width - 1)
            z = double(other["denoised"])
            guides = {role: double(other[role]) for role in ("albedo", "normal")}
            centre = {role: double(own[role]) for role in ("albedo", "normal")}
            by_features = shot.validity(centre, guides, double(field))
            light = shot.same_light(double(own["denoised"]), z, (z, double(of_b)), double(field))
            valid = by_features * light
            neighbours.append((z, double(field), valid))
            outside = 1 - shot.places(double(field))[2].double()
            bilinear, _ = shot.warp(z, double(field), shot.bilinear_weights)
            cubic, _ = shot.warp(z, double(field), shot.cubic_weights)
            case.put(
                **{
                    f"field{k}_{size}": field,
                    f"neighbour{k}_denoised_{size}": other["denoised"],
                    f"neighbour{k}_denoised_of_b_{size}": of_b,
                    f"neighbour{k}_albedo_{size}": other["albedo"],
                    f"neighbour{k}_normal_{size}": other["normal"],
                    f"outside{k}_{size}": outside[None],
                    f"bilinear{k}_{size}": bilinear[0],
                    f"cubic{k}_{size}": cubic[0],
                    f"validity{k}_{size}": by_features[0],
                    f"valid_in_same_light{k}_{size}": valid[0],
                }
            )
        case.put(**{f"mean_{size}": shot.temporal_mean(double(own["denoised"]), neighbours)[0]})
    return case


def like(random, denoised):
    """The other half's picture: a tenth brighter or darker from pixel to pixel."""
    return denoised * random.uniform(*denoised.shape, low=0.9, high=1.1)


def cases():
    return [shot_case()]
