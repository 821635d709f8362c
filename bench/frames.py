"""Finds frames in folders by their file names.

    SCENE/{P.}a.exr  {P.}b.exr                  the halves, with features and perhaps their denoised layers
    SCENE/{P.}denoised{-a,-b,}.exr              denoised halves (where not in the halves' files), full buffer
    SCENE/{P.}VARIANT.denoised{-a,-b,}.exr      another denoising of the same halves: a frame of its own here
    SCENE/{P.}ref.exr, else SCENE/ref.exr       the reference; without one a frame is only timed
    SCENE/{a,b,denoised,ref}.NNNN.exr           the frames of a shot
    SCENE/render-seconds.json                   render times for equal-time figures: {"P": seconds, "NNNN": seconds}

P is usually the sample count, "64spp".
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path

SAMPLE = "sample"
RENDER_SECONDS = "render-seconds.json"


@dataclass(frozen=True)
class Frame:
    """One denoising of one pair of half buffers."""

    name: str
    a: Path
    b: Path
    denoised: Path | None
    denoised_a: Path | None = None
    denoised_b: Path | None = None
    reference: Path | None = None
    # Name of the other denoising; None: the one that belongs to the halves.
    variant: str | None = None
    # Frames of one shot count as one frame in a mean.
    shot: str | None = None
    spp: int | None = None

    @property
    def scene(self):
        return self.name.split("/")[0]

    def arguments(self):
        """Arguments of `sspc-train fit` for this frame."""
        named = {
            "--denoised-a": self.denoised_a,
            "--denoised-b": self.denoised_b,
            "--denoised": self.denoised,
            "--reference": self.reference,
        }
        options = [str(x) for key, path in named.items() if path for x in (key, path)]
        return [str(self.a), str(self.b), *options]


def find(root):
    """Frames of every folder in `root`, in a stable order."""
    folders = sorted(path for path in Path(root).iterdir() if path.is_dir())
    return [frame for folder in folders for frame in in_folder(folder, folder.name)]


def render_seconds(root):
    """Render times by frame name, from every folder's render-seconds.json: {"64spp": 41.5, "1001": 12}.

    Names in the file leave out the folder's. Raises ValueError where a file holds something else.
    """
    found = {}
    for path in sorted(Path(root).glob(f"*/{RENDER_SECONDS}")):
        times = json.loads(path.read_text())
        if not isinstance(times, dict) or not all(isinstance(t, (int, float)) and t > 0 for t in times.values()):
            raise ValueError(f"{path.parent.name}/{RENDER_SECONDS}: expected frame names with seconds above 0")
        found |= {f"{path.parent.name}/{name}" if name else path.parent.name: float(t) for name, t in times.items()}
    return found


def in_folder(folder, scene):
    """Frames of one folder."""
    names = {path.name for path in folder.iterdir() if path.is_file()}
    frames = []
    for name in sorted(names, key=natural):
        numbered = re.fullmatch(r"a\.(\d+)\.exr", name)
        plain = re.fullmatch(r"(?:(.+)\.)?a\.exr", name)
        if numbered:
            frames += of_shot(folder, names, scene, numbered[1])
        elif plain:
            frames += of_prefix(folder, names, scene, plain[1])
    return frames


def natural(name):
    """Sort key by which 16spp comes before 64spp and 256spp."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name) if part]


def of_shot(folder, names, scene, number):
    if f"b.{number}.exr" not in names:
        return []
    at = finder(folder, names)
    frame = Frame(
        name=f"{scene}/{number}",
        a=folder / f"a.{number}.exr",
        b=folder / f"b.{number}.exr",
        denoised=at(f"denoised.{number}.exr"),
        denoised_a=at(f"denoised-a.{number}.exr"),
        denoised_b=at(f"denoised-b.{number}.exr"),
        reference=at(f"ref.{number}.exr"),
        shot=scene,
    )
    return [frame]


def of_prefix(folder, names, scene, prefix):
    start = f"{prefix}." if prefix else ""
    if f"{start}b.exr" not in names:
        return []
    at = finder(folder, names)
    samples = re.fullmatch(r"(\d+)spp", prefix or "")
    base = f"{scene}/{prefix}" if prefix else scene

    def frame(name, stem, variant):
        return Frame(
            name=name,
            a=folder / f"{start}a.exr",
            b=folder / f"{start}b.exr",
            denoised=at(f"{stem}denoised.exr"),
            denoised_a=at(f"{stem}denoised-a.exr"),
            denoised_b=at(f"{stem}denoised-b.exr"),
            reference=at(f"{start}ref.exr") or at("ref.exr"),
            variant=variant,
            spp=int(samples[1]) if samples else None,
        )

    variants = (re.fullmatch(re.escape(start) + r"([^.]+)\.denoised-a\.exr", name) for name in sorted(names))
    others = [match[1] for match in variants if match and f"{start}{match[1]}.a.exr" not in names]
    own = frame(base, start, None)
    return [own] + [frame(f"{base}/{other}", f"{start}{other}.", other) for other in others]


def finder(folder, names):
    return lambda name: folder / name if name in names else None


def sample(repository):
    """The frame in the repository."""
    return in_folder(repository / "tests" / "data" / "sample", SAMPLE)
