"""Mitsuba 3 with a pass for every light, or every few of many: each group is rendered by itself, and they add up.

Mitsuba has no light groups; the names are ours.
"""

import tempfile
from pathlib import Path

from . import mitsuba_renderer, mitsuba_scenes

# More lights than this share that many groups.
GROUPS = 4


class Renderer:
    """One scene with its passes, ready to be rendered again and again."""

    def __init__(self, name, size, depth, threads):
        self.groups = {}
        build = mitsuba_scenes.build
        with tempfile.TemporaryDirectory() as folder:
            objects, _ = build(name, Path(folder))
        lights = [key for key, made in objects.items() if is_light(made)]
        for index, key in enumerate(lights):
            group = key if len(lights) <= GROUPS else f"group{index % GROUPS}"
            self.groups.setdefault(f"light_{group}", set()).add(key)
        self.renderers = {}
        for group, own in self.groups.items():
            others = set(lights) - own
            # The renderer builds the scene by its name: for its time the others are off.
            mitsuba_scenes.build = lambda name, folder, others=others: without(build(name, folder), others)
            try:
                self.renderers[group] = mitsuba_renderer.Renderer(name, size, depth, threads)
            finally:
                mitsuba_scenes.build = build

    def render(self, spp, seed):
        """Channels by name, (height, width) each."""
        channels, beauty = {}, 0
        for index, (group, renderer) in enumerate(self.renderers.items()):
            planes = renderer.render(spp, seed + 7919 * index)
            channels |= {f"{group}.{c}": planes["color"][..., i] for i, c in enumerate("RGB")}
            beauty = beauty + planes["color"]
            channels |= {f"albedo.{c}": planes["albedo"][..., i] for i, c in enumerate("RGB")}
            channels |= {f"normal.{c}": planes["normal"][..., i] for i, c in enumerate("XYZ")}
        return channels | {c: beauty[..., i] for i, c in enumerate("RGB")}


def is_light(made):
    return isinstance(made, dict) and ("emitter" in made or made.get("type") in ("spot", "point", "constant", "envmap"))


def without(scene, others):
    """A scene in which these lights are off; lamps stay where they are, black."""
    objects, camera = scene
    kept = {}
    for key, made in objects.items():
        if key not in others:
            kept[key] = made
        elif "emitter" in made:
            kept[key] = {part: value for part, value in made.items() if part != "emitter"}
    return kept, camera
