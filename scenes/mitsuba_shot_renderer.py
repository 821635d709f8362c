"""One frame of a shot by Mitsuba 3, with world positions and the matrix of its camera."""

from . import mitsuba_renderer, mitsuba_scenes
from .mitsuba_renderer import dr, mi, np

# Largest number of light bounces.
DEPTH = 10


class FirstHit(mitsuba_renderer.FirstHit):
    """As of a single frame, and the position of the first hit."""

    def aov_names(self):
        return [*super().aov_names(), *(f"position.{c}" for c in "XYZ")]

    def sample(self, scene, sampler, ray, medium=None, active=True):
        value, valid, planes = super().sample(scene, sampler, ray, medium, active)
        hit = scene.ray_intersect(mi.Ray3f(ray), active)
        place = dr.select(active & hit.is_valid(), hit.p, 0.0)
        return value, valid, [*planes, place.x, place.y, place.z]


class Renderer(mitsuba_renderer.Renderer):
    """One frame, ready to be rendered again and again."""

    integrator_class = FirstHit

    def __init__(self, name, number, size, threads):
        self.number, self.size = number, size
        super().__init__(name, size, DEPTH, threads)

    def built(self, name, folder):
        objects, self.camera = mitsuba_scenes.frame_of_shot(name, self.number, folder)
        return objects, self.camera

    def render(self, spp, seed):
        """Buffers of (height, width, channels) by role; `camera` is the matrix from the world to the picture."""
        picture = self.picture(spp, seed)
        matrix = world_to_ndc(*self.camera, self.size[0] / self.size[1])
        return mitsuba_renderer.roles(picture) | {"position": picture[..., 10:13], "camera": matrix}


def world_to_ndc(origin, target, degrees, aspect):
    """OpenEXR's worldToNDC: row vectors, x to the right and y upwards in -1..1 after the division by w."""
    origin, target = (np.asarray(place, dtype=np.float64) for place in (origin, target))
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    scale = 1 / np.tan(np.radians(degrees) / 2)
    matrix = np.zeros((4, 4))
    for column, axis in enumerate((scale / aspect * right, scale * up, forward, forward)):
        matrix[:3, column], matrix[3, column] = axis, -axis @ origin
    return matrix
