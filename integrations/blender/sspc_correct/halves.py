"""The scene as a half needs it, and as it was before."""

from contextlib import contextmanager

# Added to the user's seed for half b. Any difference will do; a large one meets no seed that a user steps through.
SEED_OF_B = 0x2545F491
LARGEST_SEED = 0x7FFFFFFF
# What a picture's file is, in the order in which Blender takes it: each setting limits the next.
IMAGE_SETTINGS = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec", "color_management")


def has_denoiser():
    """Whether this Blender's Cycles can denoise; some builds of distributions cannot."""
    try:
        import _cycles
    except ImportError:
        return False
    return getattr(_cycles, "with_openimagedenoise", True)


class Unfit(Exception):
    """The scene cannot be rendered in halves; says why and what to do."""


class Borrowed:
    """Sets attributes, and gives the old values back in the end."""

    def __init__(self):
        self.before = []

    def keep(self, owner, *names):
        """Remembers attributes that something else will change; those that this Blender lacks are left out."""
        self.before.append([(owner, name, getattr(owner, name)) for name in names if hasattr(owner, name)])

    def set(self, owner, **values):
        for name, value in values.items():
            if hasattr(owner, name):
                self.keep(owner, name)
                setattr(owner, name, value)

    def give_back(self):
        """Restores everything, the last change first; what is gone meanwhile (a closed file) needs nothing."""
        while self.before:
            for owner, name, value in self.before.pop():
                try:
                    setattr(owner, name, value)
                except (ReferenceError, AttributeError, TypeError) as error:
                    print(f"sspc: {name} is not restored: {error}")


class Halves:
    """A scene between its own settings and those of a half."""

    def __init__(self, scene, split):
        if scene.render.engine != "CYCLES":
            raise Unfit("The scene does not render with Cycles: choose Cycles as its render engine")
        if scene.render.use_multiview:
            raise Unfit("Stereoscopy is on: switch it off, or correct the files of each view with sspc itself")
        if not has_denoiser():
            raise Unfit("This Blender was built without Open Image Denoise: take one of blender.org")
        self.scene, self.split, self.borrowed = scene, split, Borrowed()
        self.seed = scene.cycles.seed

    def prepare(self):
        """Everything but the half: denoiser and its passes on, nothing after Cycles, all passes into one file."""
        scene, borrowed = self.scene, self.borrowed
        render, cycles, image = scene.render, scene.cycles, scene.render.image_settings
        if scene.animation_data:
            # A seed of "#frame" would be the same in both halves.
            for curve in scene.animation_data.drivers:
                if curve.data_path in ("cycles.seed", "cycles.samples"):
                    borrowed.set(curve, mute=True)
        borrowed.keep(cycles, "seed")
        borrowed.set(cycles, use_denoising=True)
        if self.split:
            borrowed.set(cycles, samples=max(1, cycles.samples // 2), time_limit=cycles.time_limit / 2)
        for layer in scene.view_layers:
            borrowed.set(layer, use_pass_combined=True)
            borrowed.set(layer.cycles, denoising_store_passes=True, use_denoising=True)
        borrowed.keep(render, "filepath")
        borrowed.set(render, use_compositing=False, use_sequencer=False, use_file_extension=True)
        borrowed.keep(image, *IMAGE_SETTINGS)
        values = ("MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER", "RGBA", "32", "ZIP", "FOLLOW_SCENE")
        for name, value in zip(IMAGE_SETTINGS, values):
            if hasattr(image, name):
                setattr(image, name, value)

    def show(self, half, frame, path):
        """Goes to a frame of half "a" or "b", which the next render writes to `path`."""
        seed = self.seed if half == "a" else (self.seed + SEED_OF_B) & LARGEST_SEED
        self.scene.cycles.seed = seed
        self.scene.render.filepath = str(path)
        self.scene.frame_set(frame)
        if self.scene.cycles.seed != seed:
            raise Unfit("Cycles' seed is animated, so both halves would have the same noise: remove its keyframes")


@contextmanager
def halves(scene, split):
    """The scene ready for halves; afterwards as it was, whatever happened."""
    made = Halves(scene, split)
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        made.prepare()
        yield made
    finally:
        made.borrowed.give_back()
        try:
            scene.frame_set(frame, subframe=subframe)
        except ReferenceError:
            print("sspc: the scene is gone")
