"""Makes a large frame of a small one by mirroring it: what speed and memory are measured on.

    python -m benchlib.tiled IN.exr OUT.exr --size 1280x720        (in tests/, with the reference's virtual environment)

Channels and their types stay, ZIP compresses them; what is too large is cut off. Mirroring leaves no seam, and unlike plain repeats it does not
compress better than a real frame. Noise repeats too, so such a frame says nothing of quality.
"""

import argparse

import numpy as np
import OpenEXR


def tiled(pixels, height, width):
    """The array [h, w] mirrored on and on to [height, width]."""
    rows, columns = mirrored(height, pixels.shape[0]), mirrored(width, pixels.shape[1])
    return np.ascontiguousarray(pixels[rows][:, columns])


def mirrored(length, period):
    """Indices 0, 1, ..., period - 1, period - 1, ..., 1, 0, 0, 1, ... of that length."""
    at = np.arange(length) % (2 * period)
    return np.minimum(at, 2 * period - 1 - at)


def write_tiled(source, target, height, width):
    """Writes `target` with every channel of `source` mirrored on and on."""
    channels = OpenEXR.File(str(source), separate_channels=True).channels()
    large = {name: tiled(channel.pixels, height, width) for name, channel in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, large).write(str(target))


def size(text):
    """WIDTHxHEIGHT as (height, width)."""
    width, height = text.lower().split("x")
    return int(height), int(width)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source")
    parser.add_argument("target")
    parser.add_argument("--size", type=size, required=True, metavar="WIDTHxHEIGHT")
    arguments = parser.parse_args()
    write_tiled(arguments.source, arguments.target, *arguments.size)


if __name__ == "__main__":
    main()
