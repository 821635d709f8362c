"""The scenes by name: who renders them and what makes them hard. Imports no renderer."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Scene:
    """One scene; `hard` is what denoising and correcting find hard in it."""

    name: str
    # "mitsuba" or "cycles".
    renderer: str
    hard: str
    # Samples of the reference in total, so that its own noise stays well below that of the frames.
    reference_spp: int = 1024
    # Largest number of light bounces.
    depth: int = 10


SCENES = {
    scene.name: scene
    for scene in (
        Scene("door-crack", "mitsuba", "textured room lit through the crack of a door: all light is indirect"),
        Scene(
            "sun-and-metal", "mitsuba", "rough metal and gloss on a checker floor under a small, bright sun: fireflies"
        ),
        Scene("glass-table", "mitsuba", "caustics of glass on fine weave: bright rare paths over texture"),
        Scene("fog", "mitsuba", "homogeneous fog, a lamp and coloured lights: features that do not see the noise"),
        Scene("many-lights", "mitsuba", "some hundred small coloured lights, shadows of columns and gratings"),
        Scene("leaves", "mitsuba", "thousands of leaves before an empty background: half of the frame is black"),
        Scene("uplight", "mitsuba", "room of plain walls lit by its ceiling: smooth indirect light, moderate noise"),
        Scene("fur-and-cloth", "cycles", "hair balls and woven cloth out of focus: noisy features", 512),
        Scene("motion", "cycles", "fast textured objects with motion blur: noisy features", 512),
        Scene("stage", "cycles", "lamps, a shining sign, glass, metal and smoke: every lobe and many lights", 512),
        Scene("product", "cycles", "bumpy wood and ceramic in soft light: little noise, much texture", 512),
    )
}
