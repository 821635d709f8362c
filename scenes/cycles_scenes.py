"""The scenes for Blender Cycles, z up. Each builds into Blender's empty scene and returns nothing."""

import math

import bpy
import numpy as np

from . import textures


def build(name):
    {
        "fur-and-cloth": fur_and_cloth,
        "motion": motion,
        "product": product,
        "stage": stage,
        # Shots.
        "lantern": lantern,
        "shutter": shutter,
    }[name]()


def fur_and_cloth():
    """Two hair balls on woven cloth; the camera's depth of field leaves one of them sharp."""
    cloth = principled("cloth", textures.weave(2048, 128), repeat=3, roughness=0.9)
    plane((0, 0, 0), 7, cloth)
    wall = plane((0, 3.5, 2), 7, principled("wall", textures.wallpaper(), repeat=3, roughness=0.8))
    wall.rotation_euler = (math.radians(90), 0, 0)
    hair_ball("brown", (-0.75, 0.1, 0.75), 0.55, (0.35, 0.16, 0.06), strands=9000, seed=1)
    hair_ball("white", (0.85, 1.1, 0.65), 0.45, (0.80, 0.76, 0.68), strands=7000, seed=2)
    ball(
        (0.35, -0.75, 0.3),
        0.3,
        principled("stripes", textures.weave(512, 24, (0.8, 0.2, 0.1), (0.9, 0.85, 0.7)), repeat=4, roughness=0.4),
    )
    cube(
        (-1.9, 1.4, 0.5),
        (0.5, 0.5, 0.5),
        principled("crate", textures.planks(512, 6), repeat=1, roughness=0.6),
        turn=25,
    )
    area_light((2.5, -2.5, 4.0), (0, 0, 0.4), size=0.8, watts=420)
    sky((0.30, 0.38, 0.50), 0.35)
    camera((0.3, -5.2, 2.0), (0, 0.2, 0.55), lens=45, focus=5.4, aperture=1.2)


def move_in_the_frame(made, way, turn):
    """Moves an object by `way` and turns it by `turn` radians about its place during the rendered frame."""
    place, angle = made.location.copy(), made.rotation_euler.copy()
    for frame, sign in ((0, -1), (2, 1)):
        made.location = [p + sign * w for p, w in zip(place, way)]
        made.rotation_euler = [a + sign * t for a, t in zip(angle, turn)]
        made.keyframe_insert("location", frame=frame)
        made.keyframe_insert("rotation_euler", frame=frame)


def motion(move=move_in_the_frame):
    """Objects that move and turn while the shutter is open, over a floor that stands still."""
    plane((0, 0, 0), 8, principled("floor", textures.checker(1024, 16), repeat=2, roughness=0.35))
    wall = plane((0, 4, 2), 8, principled("bricks", textures.bricks(), repeat=2, roughness=0.8))
    wall.rotation_euler = (math.radians(90), 0, 0)
    wheel = cube((-1.5, 0.3, 0.9), (0.6, 0.6, 0.6), principled("terrazzo", textures.speckle(), repeat=1, roughness=0.5))
    move(wheel, (0.0, 0, 0), (0.3, 0.9, 0.5))
    runner = ball(
        (0.4, -0.3, 0.45),
        0.45,
        principled("checks", textures.checker(512, 10, (0.8, 0.25, 0.1), (0.85, 0.8, 0.7)), repeat=2, roughness=0.2),
    )
    move(runner, (1.1, 0.1, 0.0), (0, 1.5, 0))
    metal = ball((1.9, 0.9, 0.55), 0.55, principled("metal", (0.9, 0.7, 0.4), roughness=0.15, metallic=1.0))
    move(metal, (0.0, 0.0, 0.5), (0, 0, 0))
    flag = cube(
        (-0.1, 1.6, 1.5), (0.8, 0.02, 0.5), principled("flag", textures.weave(512, 40), repeat=1, roughness=0.8)
    )
    move(flag, (-0.5, 0.2, 0.25), (0.2, 0, 0.8))
    still = cube(
        (-0.6, -1.4, 0.2),
        (0.4, 0.2, 0.2),
        principled("still", textures.planks(512, 5), repeat=1, roughness=0.5),
        turn=-20,
    )
    still.name = "still"
    area_light((-3, -2.5, 4.5), (0, 0, 0.5), size=1.0, watts=320)
    area_light((3.5, -1.0, 2.5), (0, 0.5, 0.8), size=0.4, watts=70)
    sky((0.35, 0.42, 0.55), 0.3)
    camera((0.2, -6.0, 2.2), (0.1, 0.2, 0.75), lens=42)
    scene = bpy.context.scene
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 0.6


def product():
    """Ceramic, wood and leather in the light of large soft boxes."""
    plane((0, 0, 0), 6, principled("table", textures.planks(2048, 10), repeat=1.5, roughness=0.35, bump=0.25))
    wall = plane((0, 3, 2), 6, principled("paper", (0.75, 0.74, 0.72), roughness=0.9))
    wall.rotation_euler = (math.radians(90), 0, 0)
    leather = 0.5 + 0.5 * textures.noise(1024, 96, 12, 2)[..., None] * np.ones(3)
    cube(
        (-1.0, 0.3, 0.35),
        (0.6, 0.45, 0.35),
        principled("leather", np.clip(leather * (0.30, 0.13, 0.07), 0.01, 1), repeat=1, roughness=0.55, bump=0.6),
        turn=18,
        bevel=0.06,
    )
    ball((0.55, 0.2, 0.55), 0.55, principled("ceramic", (0.80, 0.82, 0.80), roughness=0.12))
    ball(
        (1.5, -0.35, 0.3),
        0.3,
        principled(
            "glaze", textures.speckle(512, 14, (0.10, 0.18, 0.30), (0.75, 0.72, 0.6)), repeat=2, roughness=0.2, bump=0.1
        ),
    )
    ball((0.1, -0.8, 0.2), 0.2, principled("copper", (0.92, 0.55, 0.38), roughness=0.25, metallic=1.0))
    area_light((-3.0, -2.0, 3.5), (0, 0, 0.4), size=3.0, watts=160)
    area_light((3.0, -1.5, 3.0), (0, 0, 0.4), size=2.5, watts=90)
    sky((1.0, 1.0, 1.0), 0.25)
    camera((0.2, -4.6, 1.9), (0.1, 0.0, 0.38), lens=50)


def stage():
    """Three coloured lamps, a shining sign, glass, metal and smoke under a dim sky: every lobe and many lights."""
    plane((0, 0, 0), 7, principled("boards", textures.planks(2048, 12), repeat=2, roughness=0.3, bump=0.2))
    wall = plane((0, 3.2, 2), 7, principled("bricks", textures.bricks(), repeat=2, roughness=0.8))
    wall.rotation_euler = (math.radians(90), 0, 0)
    glass = principled("glass", (0.9, 0.97, 0.95), roughness=0.02)
    glass.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1.0
    ball((-0.5, -0.7, 0.42), 0.42, glass)
    ball((0.75, 0.1, 0.5), 0.5, principled("copper", (0.92, 0.55, 0.38), roughness=0.25, metallic=1.0))
    cube(
        (-1.7, 0.5, 0.55), (0.45, 0.45, 0.55), principled("crate", textures.speckle(), repeat=1, roughness=0.6), turn=25
    )
    ball((1.75, -0.5, 0.32), 0.32, principled("cloth", textures.weave(512, 30), repeat=3, roughness=0.8))
    sign = principled("sign", (0.1, 0.1, 0.1))
    surface = sign.node_tree.nodes["Principled BSDF"]
    surface.inputs["Emission Color"].default_value = (0.2, 0.5, 1.0, 1)
    surface.inputs["Emission Strength"].default_value = 12.0
    cube((0.1, 2.9, 1.6), (0.9, 0.03, 0.06), sign).lightgroup = "sign"
    smoke = bpy.data.materials.new("smoke")
    smoke.use_nodes = True
    scatter = smoke.node_tree.nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 0.3
    smoke.node_tree.nodes.remove(smoke.node_tree.nodes["Principled BSDF"])
    smoke.node_tree.links.new(scatter.outputs["Volume"], smoke.node_tree.nodes["Material Output"].inputs["Volume"])
    cube((-2.6, 2.0, 1.2), (0.7, 0.7, 1.1), smoke)
    for name, place, size, watts, colour in (
        ("key", (-3.0, -2.5, 3.8), 0.6, 260, (1.0, 0.85, 0.65)),
        ("rim", (2.8, 2.0, 2.6), 0.3, 160, (0.5, 0.7, 1.0)),
        ("fill", (3.0, -3.0, 2.0), 1.5, 60, (1.0, 0.45, 0.35)),
    ):
        area_light(place, (0, 0, 0.5), size, watts)
        lamp = bpy.context.scene.collection.objects[-1]
        lamp.data.color, lamp.lightgroup = colour, name
    sky((0.30, 0.38, 0.50), 0.15)
    camera((0.2, -5.2, 1.9), (0.05, 0.2, 0.6), lens=42)


def lantern():
    """A lamp swings before columns, another flickers; fur, glass and metal roll and turn, the camera glides."""
    plane((0, 0, 0), 8, principled("floor", textures.planks(2048, 14), repeat=2, roughness=0.4))
    wall = plane((0, 3.6, 2), 8, principled("bricks", textures.bricks(), repeat=2, roughness=0.8))
    wall.rotation_euler = (math.radians(90), 0, 0)
    for index, x in enumerate((-2.4, -0.9, 0.8, 2.3)):
        cube(
            (x, 1.9, 1.2),
            (0.14, 0.14, 1.2),
            principled(f"column {index}", textures.speckle(512, 20 + index), roughness=0.7),
        )
    glass = principled("glass", (0.92, 0.97, 0.95), roughness=0.02)
    glass.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1.0
    roll = ball((-0.2, -1.1, 0.38), 0.38, glass)
    travel(roll, (0.06, 0, 0), (0, 0.16, 0))
    copper = ball((1.35, -0.3, 0.45), 0.45, principled("copper", (0.92, 0.55, 0.38), roughness=0.2, metallic=1.0))
    travel(copper, (-0.03, 0.02, 0), (0, 0, 0))
    crate = cube(
        (0.35, 0.5, 0.4), (0.4, 0.4, 0.4), principled("crate", textures.checker(512, 8), roughness=0.5), turn=20
    )
    travel(crate, (0, 0, 0), (0, 0, math.radians(4)))
    hair_ball("fox", (-1.5, -0.2, 0.7), 0.5, (0.45, 0.2, 0.07), strands=8000, seed=5)
    area_light((-1.2, -2.2, 2.6), (0, 0.4, 0.4), size=0.25, watts=150)
    travel(bpy.context.scene.collection.objects[-1], (0.28, 0.02, 0), (0, 0, 0))
    area_light((3.2, -1.5, 3.0), (0.6, 0.3, 0.4), size=0.8, watts=60)
    flicker = bpy.context.scene.collection.objects[-1].data
    for number, watts in enumerate((120, 200, 95, 180, 110, 210), start=1):
        flicker.energy = watts
        flicker.keyframe_insert("energy", frame=number)
    sky((0.30, 0.38, 0.50), 0.12)
    camera((0.1, -5.6, 1.9), (0.0, 0.2, 0.65), lens=40)
    travel(bpy.context.scene.camera, (0.05, 0.04, 0.01), (0, 0, 0))


def shutter():
    """`motion` as a shot: blurred by the open shutter, with another camera after the third frame."""
    motion(lambda made, way, turn: travel(made, [0.2 * w for w in way], [0.2 * t for t in turn]))
    scene = bpy.context.scene
    first = scene.camera
    camera((-2.6, -4.2, 1.5), (0.2, 0.2, 0.7), lens=48)
    for number, seen in ((1, first), (4, scene.camera)):
        scene.timeline_markers.new(f"camera {number}", frame=number).camera = seen


# Parts that scenes are made of.


def principled(name, colour, repeat=1.0, roughness=0.5, metallic=0.0, bump=0.0):
    """A principled material; `colour` is (r, g, b) or a texture, which also makes the bumps."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = nodes["Principled BSDF"]
    surface.inputs["Roughness"].default_value = roughness
    surface.inputs["Metallic"].default_value = metallic
    if np.ndim(colour) == 1:
        surface.inputs["Base Color"].default_value = (*map(float, colour), 1)
        return material
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image(name, colour)
    place, where = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeTexCoord")
    place.inputs["Scale"].default_value = (repeat, repeat, 1)
    links.new(where.outputs["UV"], place.inputs["Vector"])
    links.new(place.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    if bump:
        bumps = nodes.new("ShaderNodeBump")
        bumps.inputs["Strength"].default_value = bump
        bumps.inputs["Distance"].default_value = 0.02
        links.new(texture.outputs["Color"], bumps.inputs["Height"])
        links.new(bumps.outputs["Normal"], surface.inputs["Normal"])
    return material


def image(name, texture):
    height, width, _ = texture.shape
    picture = bpy.data.images.new(name, width, height, float_buffer=True)
    # Values are linear reflectances already.
    picture.colorspace_settings.name = "Non-Color"
    texels = np.ones((height, width, 4), dtype=np.float32)
    texels[..., :3] = texture
    picture.pixels.foreach_set(texels.ravel())
    picture.pack()
    return picture


def hair_ball(name, centre, radius, colour, strands, seed):
    """A ball with bent strands of hair all over it."""
    points = 8
    random = np.random.default_rng(seed)
    outward = random.normal(0, 1, (strands, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    length = 0.4 * radius * random.uniform(0.6, 1.3, (strands, 1, 1))
    share = np.linspace(0, 1, points)[None, :, None]
    bend = random.normal(0, 0.35, (strands, 1, 3)) + (0, 0, -0.6)
    positions = np.asarray(centre) + outward[:, None] * radius + length * (share * outward[:, None] + share**2 * bend)
    curves = bpy.data.hair_curves.new(name)
    curves.add_curves([points] * strands)
    curves.position_data.foreach_set("vector", positions.astype(np.float32).ravel())
    thickness = curves.attributes.new("radius", "FLOAT", "POINT")
    taper = np.broadcast_to(0.004 * radius / 0.5 * (1 - 0.8 * np.linspace(0, 1, points)), (strands, points))
    thickness.data.foreach_set("value", taper.astype(np.float32).ravel())
    hair = principled(f"{name} hair", colour, roughness=0.45)
    curves.materials.append(hair)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, curves))
    ball(centre, radius, hair)


def plane(centre, half, material):
    bpy.ops.mesh.primitive_plane_add(size=2 * half, location=centre)
    return finished(material)


def ball(centre, radius, material):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, location=centre, segments=64, ring_count=32)
    bpy.ops.object.shade_smooth()
    return finished(material)


def cube(centre, half, material, turn=0, bevel=0.0):
    """A box by its centre and half its edges, turned about z."""
    bpy.ops.mesh.primitive_cube_add(size=2, location=centre, rotation=(0, 0, math.radians(turn)), scale=half)
    made = finished(material)
    if bevel:
        edges = made.modifiers.new("bevel", "BEVEL")
        edges.width, edges.segments = bevel, 4
    return made


def finished(material):
    made = bpy.context.object
    made.data.materials.append(material)
    return made


def travel(made, way, turn, frames=8):
    """Moves an object by `way` and turns it by `turn` radians, each frame anew and as far, from frame 1 on."""
    place, angle = made.location.copy(), made.rotation_euler.copy()
    for frame in range(frames + 1):
        made.location = [p + (frame - 1) * w for p, w in zip(place, way)]
        made.rotation_euler = [a + (frame - 1) * t for a, t in zip(angle, turn)]
        made.keyframe_insert("location", frame=frame)
        made.keyframe_insert("rotation_euler", frame=frame)


def area_light(place, target, size, watts):
    lamp = bpy.data.lights.new("area", "AREA")
    lamp.size, lamp.energy = size, watts
    made = bpy.data.objects.new("area", lamp)
    made.location = place
    aim(made, target)
    bpy.context.scene.collection.objects.link(made)


def sky(colour, strength):
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*colour, 1)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = world


def camera(place, target, lens, focus=None, aperture=None):
    """A camera of focal length `lens` in mm, with depth of field given `focus` (distance) and `aperture` (f-number)."""
    data = bpy.data.cameras.new("camera")
    data.lens = lens
    if focus:
        data.dof.use_dof = True
        data.dof.focus_distance = focus
        # f-numbers of a real lens blur little in a scene of metres: scaled to a large one.
        data.dof.aperture_fstop = aperture / 10
    made = bpy.data.objects.new("camera", data)
    made.location = place
    aim(made, target)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.scene.camera = made


def aim(made, target):
    from mathutils import Vector

    made.rotation_euler = (Vector(target) - made.location).to_track_quat("-Z", "Y").to_euler()
