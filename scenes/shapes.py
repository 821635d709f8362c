"""Triangle meshes as arrays, and their PLY files."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Mesh:
    """positions (n, 3), texture coordinates (n, 2), triangles (m, 3) of vertex numbers."""

    positions: np.ndarray
    uv: np.ndarray
    triangles: np.ndarray


def foliage(plants, leaves, seed, radius=3.0):
    """Leaves of two triangles each, on stems at random places in a disc of `radius` around the origin, y up."""
    random = np.random.default_rng(seed)
    count = plants * leaves
    angle = random.uniform(0, 2 * np.pi, plants)
    distance = radius * np.sqrt(random.uniform(0, 1, plants))
    foot = np.stack([distance * np.cos(angle), np.zeros(plants), distance * np.sin(angle)], -1)
    height = random.uniform(0.5, 2.4, plants)
    lean = random.normal(0, 0.25, (plants, 3)) * (1, 0, 1)
    share = random.uniform(0.1, 1, (plants, leaves))
    stem = (
        foot[:, None]
        + share[..., None] * (height[:, None] * (0, 1, 0))[:, None]
        + (share**2)[..., None] * lean[:, None]
    )
    along = unit(random.normal(0, 1, (count, 3)) + (0, 0.25, 0))
    across = unit(np.cross(along, random.normal(0, 1, (count, 3))))
    length = random.uniform(0.08, 0.28, (count, 1)) * (1.2 - share.reshape(-1, 1))
    start = stem.reshape(-1, 3)
    middle, tip = start + 0.5 * length * along, start + length * along
    # A leaf sags at its tip, so its halves have different normals.
    tip = tip - length * (0, 0.3, 0)
    side = 0.22 * length * across
    positions = np.stack([start, middle - side, middle + side, tip], 1).reshape(-1, 3)
    # u: which leaf (colour), v: along the leaf.
    hue = random.uniform(0, 1, (count, 1)).repeat(4, 1)
    uv = np.stack([hue, np.broadcast_to([0.02, 0.5, 0.5, 0.98], (count, 4))], -1).reshape(-1, 2)
    first = 4 * np.arange(count)[:, None]
    triangles = np.stack([first + (0, 1, 2), first + (1, 3, 2)], 1).reshape(-1, 3)
    return Mesh(positions, uv, triangles)


def torus(centre, radius, tube, around=96, across=48):
    """A torus that lies in the plane y = centre's."""
    p, q = np.meshgrid(np.arange(around + 1) / around, np.arange(across + 1) / across, indexing="ij")
    a, b = 2 * np.pi * p, 2 * np.pi * q
    reach = radius + tube * np.cos(b)
    positions = np.stack([reach * np.cos(a), tube * np.sin(b), reach * np.sin(a)], -1) + centre
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    corner = (i * (across + 1) + j).reshape(-1, 1)
    right = corner + across + 1
    triangles = np.concatenate([np.hstack([corner, corner + 1, right]), np.hstack([right, corner + 1, right + 1])])
    return Mesh(positions.reshape(-1, 3), np.stack([p, q], -1).reshape(-1, 2), triangles)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def write_ply(path, mesh):
    """Binary PLY with texture coordinates; normals are left to the renderer."""
    vertices = np.hstack([mesh.positions, mesh.uv]).astype("<f4")
    faces = np.empty(len(mesh.triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "u", "v"))
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    with open(path, "wb") as file:
        file.write(header.encode())
        file.write(vertices.tobytes())
        file.write(faces.tobytes())
