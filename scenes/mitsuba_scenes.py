"""The scenes for Mitsuba 3 as dictionaries, y up. Set a variant first; `folder` is for mesh files."""

import mitsuba as mi
import numpy as np

from . import shapes, textures


def build(name, folder):
    """(objects by name, camera) of a scene; the camera is (position, target, vertical field of view in degrees)."""
    return {
        "door-crack": door_crack,
        "sun-and-metal": sun_and_metal,
        "glass-table": glass_table,
        "fog": fog,
        "many-lights": many_lights,
        "leaves": leaves,
        "uplight": uplight,
    }[name](folder)


def frame_of_shot(name, number, folder):
    """(objects by name, camera) of a frame of a shot, counted from 1."""
    return {"glass-orbit": glass_orbit}[name](number, folder)


def glass_orbit(number, folder):
    """The camera goes around the glass table, and its lamp dims and comes back."""
    scene, (origin, target, degrees) = glass_table(folder)
    angle = np.radians(1.5 * (number - 3))
    x, height, z = np.subtract(origin, target)
    turned = (np.cos(angle) * x + np.sin(angle) * z, height, np.cos(angle) * z - np.sin(angle) * x)
    brightness = (1.0, 1.0, 0.7, 0.45, 0.75, 1.0)[(number - 1) % 6]
    scene["lamp"] |= light(*(brightness * np.array((75, 66, 52))))
    return scene, (tuple(np.add(target, turned)), target, degrees)


def door_crack(folder):
    wall, floor = paint(textures.bricks(), (3, 2)), paint(textures.planks(), (3, 3))
    paper, plain = paint(textures.wallpaper(), (2, 1.2)), colour(0.75, 0.72, 0.66)
    door = paint(textures.planks(512, 5, 9), (1, 1))
    hinge, open_degrees = np.array([-2.5, 0, -1.3]), 38
    swing = np.array([np.sin(np.radians(open_degrees)), 0, np.cos(np.radians(open_degrees))])
    scene = {
        "floor": panel((-5, 0, 3), (8, 0, 0), (0, 0, -6), floor),
        "ceiling": panel((-5, 2.7, -3), (8, 0, 0), (0, 0, 6), plain),
        "back": panel((-2.5, 0, -3), (5.5, 0, 0), (0, 2.7, 0), paper),
        "front": panel((3, 0, 3), (-5.5, 0, 0), (0, 2.7, 0), plain),
        "right": panel((3, 0, -3), (0, 0, 6), (0, 2.7, 0), paper),
        # The wall with the door: left and right of it, and above.
        "door-left": panel((-2.5, 0, -1.3), (0, 0, -1.7), (0, 2.7, 0), wall),
        "door-right": panel((-2.5, 0, 3), (0, 0, -3.3), (0, 2.7, 0), wall),
        "door-above": panel((-2.5, 2.1, -0.3), (0, 0, -1), (0, 0.6, 0), wall),
        "door": box(hinge + 0.5 * swing + (0, 1.05, 0), (0.02, 1.05, 0.5), door, open_degrees),
        # The corridor behind it, where the only lamp is.
        "corridor-wall": panel((-5, 0, 3), (0, 0, -6), (0, 2.7, 0), colour(0.8, 0.75, 0.6)),
        "corridor-end": panel((-5, 0, -3), (2.5, 0, 0), (0, 2.7, 0), plain),
        "corridor-front": panel((-2.5, 0, 3), (-2.5, 0, 0), (0, 2.7, 0), plain),
        "lamp": panel((-4.1, 2.65, -1.1), (0.6, 0, 0), (0, 0, 0.6), colour(0.5, 0.5, 0.5)) | light(900, 780, 600),
        "table": box((0.2, 0.72, -1.2), (0.7, 0.03, 0.45), paint(textures.planks(512, 6, 21), (1, 1)), 15),
        "cloth": box((0.2, 0.76, -1.2), (0.45, 0.006, 0.3), paint(textures.weave(1024, 64), (1, 1)), 5),
        "vase": sphere((0.1, 0.93, -1.2), 0.17, gloss(0.5, 0.1, 0.08)),
        "ball": sphere((0.42, 0.86, -1.05), 0.1, metal(0.85, 0.7, 0.4, roughness=0.15)),
        "crate": box((1.6, 0.35, -2.2), (0.35, 0.35, 0.35), paint(textures.speckle(), (1, 1)), 25),
        "globe": sphere((-1.4, 0.3, -2.3), 0.3, paint(textures.checker(512, 12), (2, 1))),
    }
    for index, (x, z) in enumerate(((-0.4, -1.55), (0.8, -1.55), (-0.4, -0.85), (0.8, -0.85))):
        scene[f"leg-{index}"] = box((x, 0.35, z), (0.03, 0.35, 0.03), colour(0.25, 0.14, 0.07))
    return scene, ((1.9, 1.5, 2.7), (-0.5, 0.95, -1.6), 48)


def sun_and_metal(folder):
    random = np.random.default_rng(11)
    scene = {
        "floor": panel((-12, 0, 12), (24, 0, 0), (0, 0, -24), paint(textures.checker(1024, 16), (2, 2))),
        "sky": {"type": "envmap", "bitmap": bitmap(textures.sky())},
        "pedestal": box((0, 0.2, -0.5), (1.2, 0.2, 1.2), paint(textures.speckle(), (1, 1)), 20),
    }
    materials = (
        lambda c: metal(*c, roughness=0.08),
        lambda c: metal(*c, roughness=0.3),
        lambda c: gloss(*c),
        lambda c: {"type": "roughplastic", "diffuse_reflectance": rgb(*c), "alpha": 0.2},
        lambda c: metal(*c, roughness=0.5),
    )
    placed = [(np.array([0.0, -0.5]), 0.8)]
    scene["large"] = sphere((0, 1.1, -0.5), 0.7, metal(0.95, 0.75, 0.45, roughness=0.12))
    while len(placed) < 26:
        centre, radius = random.uniform((-4, -4.5), (4, 3)), random.uniform(0.18, 0.55)
        if (
            all(np.hypot(*(centre - other)) > radius + extent + 0.05 for other, extent in placed[1:])
            and np.hypot(*(centre - placed[0][0])) > 1.8 + radius
        ):
            material = materials[len(placed) % len(materials)](random.uniform(0.2, 0.95, 3))
            scene[f"sphere-{len(placed)}"] = sphere((centre[0], radius, centre[1]), radius, material)
            placed.append((centre, radius))
    return scene, ((2.5, 2.2, 6.2), (0, 0.55, -0.4), 36)


def glass_table(folder):
    clear = {"type": "dielectric", "int_ior": 1.5}
    shapes.write_ply(folder / "ring.ply", shapes.torus((0.55, 0.12, 0.45), 0.3, 0.115))
    scene = {
        "table": panel((-4, 0, 3), (8, 0, 0), (0, 0, -7), paint(textures.weave(2048, 160), (2.2, 2.2))),
        "wall": panel((-4, 0, -2.2), (8, 0, 0), (0, 5, 0), paint(textures.wallpaper(), (2, 1.2))),
        "lamp": sphere((-1.9, 2.6, 0.9), 0.22, colour(0.5, 0.5, 0.5)) | light(75, 66, 52),
        "fill": {"type": "constant", "radiance": rgb(0.07, 0.08, 0.1)},
        "ball": sphere((-0.5, 0.42, 0.1), 0.42, clear),
        "small": sphere((0.02, 0.16, 0.85), 0.16, clear),
        "ring": {"type": "ply", "filename": str(folder / "ring.ply"), "bsdf": clear},
        "tinted": box(
            (0.75, 0.4, -0.65),
            (0.28, 0.4, 0.28),
            {"type": "dielectric", "int_ior": 1.4, "specular_transmittance": rgb(0.55, 0.85, 0.65)},
            30,
        ),
        "frosted": sphere((1.45, 0.3, 0.1), 0.3, {"type": "roughdielectric", "alpha": 0.12, "int_ior": 1.5}),
        "book": box((-1.5, 0.09, -0.5), (0.45, 0.09, 0.6), paint(textures.bricks(512, 8, 4), (1, 1)), 25),
        "apple": sphere((-1.4, 0.36, -0.4), 0.18, gloss(0.5, 0.06, 0.04)),
    }
    return scene, ((0.5, 1.7, 3.6), (0.05, 0.28, 0.05), 32)


def fog(folder):
    inside = {"exterior": {"type": "ref", "id": "medium"}}
    walls = panel_room(
        (-4, 0, -6), (4, 3.6, 5), inside, paint(textures.bricks(), (3, 1.3)), paint(textures.planks(), (3, 3))
    )
    scene = {
        "medium": {"type": "homogeneous", "albedo": 0.92, "sigma_t": 0.13},
        **walls,
        "spot": {
            "type": "spot",
            "to_world": look((-1.5, 3.5, 0.5), (0.3, 0, -1.4)),
            "intensity": rgb(390, 350, 285),
            "cutoff_angle": 24,
            "beam_width": 19,
        },
        "red": sphere((-2.7, 0.5, -3.8), 0.12, colour(0.5, 0.5, 0.5)) | light(210, 27, 15),
        "blue": sphere((2.8, 1.9, -3.0), 0.12, colour(0.5, 0.5, 0.5)) | light(18, 48, 225),
        "crate": box((0.9, 0.45, -1.0), (0.45, 0.45, 0.45), paint(textures.checker(512, 6), (1, 1)), 30),
        "ball": sphere((-0.6, 0.4, -1.6), 0.4, gloss(0.2, 0.5, 0.25)),
        "cloth": box((0.9, 0.93, -1.0), (0.3, 0.02, 0.3), paint(textures.weave(512, 48), (1, 1)), 12),
    }
    for index, (x, z) in enumerate(((-2, -2.2), (2, -2.4), (-2, -4.6), (2.1, -4.8), (0, -4.2))):
        scene[f"column-{index}"] = cylinder(
            (x, 0, z), (x, 3.6, z), 0.22, paint(textures.speckle(512, 30 + index), (2, 3))
        )
    return scene, ((0.3, 1.5, 4.2), (0, 1.2, -2), 46)


def many_lights(folder):
    random = np.random.default_rng(5)
    scene = {
        "floor": panel((-8, 0, 8), (16, 0, 0), (0, 0, -16), paint(textures.speckle(1024, 3), (4, 4))),
        "wall": panel((-8, 0, -5), (16, 0, 0), (0, 6, 0), paint(textures.bricks(), (5, 2))),
        "left": panel((-5, 0, 8), (0, 0, -16), (0, 6, 0), paint(textures.wallpaper(), (5, 2))),
        "sculpture": sphere((0, 1.0, -1), 0.6, metal(0.9, 0.6, 0.4, roughness=0.2)),
        "plinth": box((0, 0.2, -1), (0.7, 0.2, 0.7), paint(textures.checker(512, 5), (1, 1)), 15),
    }
    for index in range(220):
        place = random.uniform((-4.8, 0.15, -4.8), (4.8, 3.4, 3.0))
        power = random.lognormal(3.0, 0.8)
        scene[f"light-{index}"] = sphere(place, 0.03, colour(0.5, 0.5, 0.5)) | light(*(power * hue(random.uniform())))
    for index, (x, z) in enumerate(((-3, -3), (-1, -3.4), (1.2, -3.2), (3.2, -2.8), (-2.6, 0.4), (2.6, 0.2))):
        scene[f"column-{index}"] = cylinder(
            (x, 0, z), (x, 4, z), 0.25, paint(textures.planks(512, 6, 40 + index), (2, 1))
        )
    for index in range(18):
        x = -1.7 + 0.2 * index
        scene[f"bar-{index}"] = box((x, 0.6, 1.3), (0.02, 0.6, 0.02), gloss(0.15, 0.15, 0.18))
    return scene, ((1.2, 2.0, 6.0), (-0.1, 1.0, -1.5), 44)


def leaves(folder):
    shapes.write_ply(folder / "leaves.ply", shapes.foliage(plants=150, leaves=240, seed=8, radius=2.6))
    u, v = textures.coordinates(256)
    rib = (np.abs(np.sin(24 * np.pi * v)) < 0.25)[..., None]
    green = textures.mix((0.05, 0.20, 0.03), (0.40, 0.42, 0.07), u + 0.2 * textures.noise(256, 16, 3))
    autumn = np.where((u > 0.85)[..., None], (0.55, 0.16, 0.04), green)
    scene = {
        "leaves": {
            "type": "ply",
            "filename": str(folder / "leaves.ply"),
            "face_normals": True,
            "bsdf": paint(np.where(rib, 1.6 * autumn, autumn), (1, 1)),
        },
        "ground": {
            "type": "disk",
            "to_world": T().rotate([1, 0, 0], -90).scale(3.0),
            "bsdf": paint(textures.ground(), (2, 2)),
        },
        "sun": {"type": "directional", "direction": [-0.55, -0.8, -0.45], "irradiance": rgb(5, 4.6, 3.8)},
        # A sky that lights the plants but is out of sight and beside the sun: the background stays empty.
        "sky": panel((-22, 14, -14), (26, 0, 0), (0, 0, 28), colour(0, 0, 0)) | light(1.2, 1.5, 2.1),
    }
    return scene, ((0, 1.5, 8.6), (0, 1.15, 0), 25)


def uplight(folder):
    plain, wood = colour(0.78, 0.76, 0.72), paint(textures.planks(512, 6, 21), (1, 1))
    scene = {
        "floor": panel((-3, 0, 3), (6, 0, 0), (0, 0, -6), paint(textures.planks(), (2, 2))),
        "ceiling": panel((-3, 2.7, -3), (6, 0, 0), (0, 0, 6), colour(0.85, 0.85, 0.85)),
        "back": panel((-3, 0, -3), (6, 0, 0), (0, 2.7, 0), plain),
        "front": panel((3, 0, 3), (-6, 0, 0), (0, 2.7, 0), plain),
        "left": panel((-3, 0, 3), (0, 0, -6), (0, 2.7, 0), colour(0.62, 0.36, 0.25)),
        "right": panel((3, 0, -3), (0, 0, 6), (0, 2.7, 0), colour(0.35, 0.5, 0.6)),
        # Lamps: a window beside the camera, and two sheets that light the ceiling, and through it the room.
        "window": panel((-2.99, 0.9, 2.6), (0, 0, -2.2), (0, 1.4, 0), colour(0.2, 0.2, 0.2)) | light(1.6, 1.9, 2.4),
        "shade": box((-0.2, 2.1, -1), (0.7, 0.02, 0.5), colour(0.7, 0.7, 0.7)),
        "lamp": panel((-0.85, 2.13, -0.55), (1.3, 0, 0), (0, 0, -0.9), colour(0.2, 0.2, 0.2)) | light(13, 11.5, 9.5),
        "sconce": box((2.75, 1.9, -1.4), (0.2, 0.03, 0.35), colour(0.7, 0.7, 0.7)),
        "glow": panel((2.58, 1.94, -1.1), (0.3, 0, 0), (0, 0, -0.6), colour(0.2, 0.2, 0.2)) | light(10, 12, 15),
        "rug": panel((-1.4, 0.01, 0.4), (2.4, 0, 0), (0, 0, -1.8), paint(textures.weave(1024, 48), (1, 1))),
        "table": box((-0.2, 0.72, -1.2), (0.8, 0.03, 0.5), wood, 12),
        "vase": sphere((-0.5, 0.95, -1.2), 0.2, gloss(0.5, 0.1, 0.08)),
        "glass": sphere((0.15, 0.92, -1.1), 0.17, {"type": "dielectric", "int_ior": 1.5}),
        "cube": box((-2.2, 0.4, -2.2), (0.4, 0.4, 0.4), colour(0.7, 0.65, 0.3), 30),
        "globe": sphere((1.6, 0.45, -1.9), 0.45, colour(0.8, 0.8, 0.8)),
        "picture": panel((-1.2, 1.2, -2.98), (1.6, 0, 0), (0, 0.9, 0), paint(textures.checker(512, 6), (1, 1))),
    }
    for index, (x, z) in enumerate(((-0.85, -1.55), (0.45, -1.55), (-0.85, -0.85), (0.45, -0.85))):
        scene[f"leg-{index}"] = box((x, 0.35, z), (0.03, 0.35, 0.03), colour(0.25, 0.14, 0.07))
    return scene, ((0.9, 1.45, 2.8), (-0.1, 1.05, -1.4), 44)


# Parts that scenes are made of.

T = mi.ScalarTransform4f


def bitmap(array):
    return mi.Bitmap(np.ascontiguousarray(array, dtype=np.float32))


def paint(array, repeat):
    """A diffuse surface of both sides with a texture repeated in u and v."""
    texture = {"type": "bitmap", "bitmap": bitmap(array), "raw": True, "to_uv": T().scale([repeat[0], repeat[1], 1])}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}


def rgb(red, green, blue):
    return {"type": "rgb", "value": [float(red), float(green), float(blue)]}


def colour(red, green, blue):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(red, green, blue)}}


def gloss(red, green, blue):
    return {"type": "plastic", "diffuse_reflectance": rgb(red, green, blue)}


def metal(red, green, blue, roughness):
    return {"type": "principled", "base_color": rgb(red, green, blue), "metallic": 1.0, "roughness": roughness}


def light(red, green, blue):
    return {"emitter": {"type": "area", "radiance": rgb(red, green, blue)}}


def hue(share):
    """A saturated colour of about unit brightness."""
    wheel = 0.5 + 0.5 * np.cos(2 * np.pi * (share + np.array([0, 1 / 3, 2 / 3])))
    return wheel / wheel.mean()


def panel(corner, u, v, bsdf):
    """A rectangle by a corner and two edges; it faces along u x v."""
    corner, u, v = (np.asarray(x, dtype=float) for x in (corner, u, v))
    normal = np.cross(u, v)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = u / 2, v / 2
    matrix[:3, 2] = normal / np.linalg.norm(normal)
    matrix[:3, 3] = corner + (u + v) / 2
    return {"type": "rectangle", "to_world": T(matrix), "bsdf": bsdf}


def panel_room(low, high, media, wall, floor):
    """Six panels that face inwards, with a medium on their inner side."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    x, y, z = x1 - x0, y1 - y0, z1 - z0
    return {
        "room-floor": panel((x0, y0, z1), (x, 0, 0), (0, 0, -z), floor) | media,
        "room-ceiling": panel((x0, y1, z0), (x, 0, 0), (0, 0, z), wall) | media,
        "room-back": panel((x0, y0, z0), (x, 0, 0), (0, y, 0), wall) | media,
        "room-front": panel((x1, y0, z1), (-x, 0, 0), (0, y, 0), wall) | media,
        "room-left": panel((x0, y0, z1), (0, 0, -z), (0, y, 0), wall) | media,
        "room-right": panel((x1, y0, z0), (0, 0, z), (0, y, 0), wall) | media,
    }


def box(centre, half, bsdf, degrees=0):
    """A box by its centre and half its edges, turned about y."""
    place = T().translate([float(x) for x in centre]).rotate([0, 1, 0], degrees).scale([float(x) for x in half])
    return {"type": "cube", "to_world": place, "bsdf": bsdf}


def sphere(centre, radius, bsdf):
    return {"type": "sphere", "center": [float(x) for x in centre], "radius": float(radius), "bsdf": bsdf}


def cylinder(foot, top, radius, bsdf):
    return {
        "type": "cylinder",
        "p0": list(map(float, foot)),
        "p1": list(map(float, top)),
        "radius": radius,
        "bsdf": bsdf,
    }


def look(origin, target):
    return T().look_at(origin=list(map(float, origin)), target=list(map(float, target)), up=[0, 1, 0])
