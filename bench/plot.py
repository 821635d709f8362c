"""relL2 over the denoiser's against seconds, both logarithmic, as a plain SVG."""

import itertools
import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 1080, 560
# Margins around the axes; the legend stands in the right one.
LEFT, RIGHT, TOP, BOTTOM = 80, 250, 70, 70
# Okabe and Ito's colours, told apart by colour-blind readers.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
DASHES = ("8 4", "2 4")


@dataclass(frozen=True)
class Point:
    label: str
    seconds: float
    ratio: float


@dataclass(frozen=True)
class Series:
    name: str
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Level:
    """A picture that takes no time here: a horizontal line. A plot has at most two."""

    name: str
    ratio: float


class Axis:
    """Logarithmic, from data to pixels."""

    def __init__(self, values, start, end):
        low, high = min(values), max(values)
        margin = max(0.08 * math.log(high / low), 0.1)
        self.low, self.high = math.log(low) - margin, math.log(high) + margin
        self.start, self.end = start, end

    def at(self, value):
        share = (math.log(value) - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self):
        """1, 2, 5 times powers of ten; equal round steps where the axis spans less than a factor of three."""
        low, high = math.exp(self.low), math.exp(self.high)
        if high / low < 3:
            rough = (high - low) / 6
            decade = 10.0 ** math.floor(math.log10(rough))
            step = next(m * decade for m in (1, 2, 5, 10) if m * decade >= rough)
            return [i * step for i in range(math.ceil(low / step), math.floor(high / step) + 1)]
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        return [m * 10.0**d for d in decades for m in (1, 2, 5) if low <= m * 10.0**d <= high]


def svg(title, subtitle, series, levels, notes=()):
    """The plot's text, `notes` below the legend; raises ValueError without any point."""
    points = [point for line in series for point in line.points]
    if not points:
        raise ValueError("a plot needs at least one point")
    x = Axis([point.seconds for point in points], LEFT, WIDTH - RIGHT)
    y = Axis([point.ratio for point in points] + [level.ratio for level in levels], HEIGHT - BOTTOM, TOP)
    body = [*frame(title, subtitle), *grid(x, y)]
    entries = [(f"{level.name} {level.ratio:.3f}", "#666", dashes) for level, dashes in zip(levels, DASHES)]
    for level, (_, colour, dashes) in zip(levels, entries):
        at = y.at(level.ratio)
        body.append(stroke(LEFT, WIDTH - RIGHT, at, colour, dashes))
    for line, colour in zip(series, itertools.cycle(COLOURS)):
        body += drawn(line, colour, x, y)
        entries.append((line.name, colour, None))
    for index, entry in enumerate(entries):
        body += legend(index, *entry)
    for index, note in enumerate(notes, len(entries)):
        body.append(text(WIDTH - RIGHT + 47, TOP + 14 + 20 * index, note, colour="#666"))
    return document(WIDTH, HEIGHT, body)


def document(width, height, body):
    """An SVG file on white of these elements."""
    size = f'viewBox="0 0 {width} {height}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="13">'
    return "\n".join([head, f'<rect width="{width}" height="{height}" fill="white"/>', *body, "</svg>", ""])


def text(x, y, words, anchor="start", colour="#222", size=13, extra=""):
    style = f'text-anchor="{anchor}" fill="{colour}" font-size="{size}"{extra}'
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(words)}</text>'


def frame(title, subtitle):
    middle = (TOP + HEIGHT - BOTTOM) / 2
    turned = f' transform="rotate(-90 22 {middle:.1f})"'
    return [
        text(LEFT, 28, title, size=17),
        text(LEFT, 48, subtitle, colour="#555", size=12),
        text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 22, "seconds, file to file (log)", "middle"),
        text(22, middle, "relL2 ÷ the denoiser's (log, lower is better)", "middle", extra=turned),
    ]


def grid(x, y, left=LEFT, top=TOP, right=WIDTH - RIGHT, bottom=HEIGHT - BOTTOM):
    """Frame, grid lines and tick labels of a panel with those edges."""
    lines = [f'<rect x="{left}" y="{top}" width="{right - left}" height="{bottom - top}" fill="none" stroke="#888"/>']
    for value in x.ticks():
        at = x.at(value)
        lines.append(f'<line x1="{at:.1f}" y1="{top}" x2="{at:.1f}" y2="{bottom}" stroke="#e5e5e5"/>')
        lines.append(text(at, bottom + 18, f"{value:g}", "middle"))
    for value in y.ticks():
        at = y.at(value)
        lines.append(f'<line x1="{left}" y1="{at:.1f}" x2="{right}" y2="{at:.1f}" stroke="#e5e5e5"/>')
        lines.append(text(left - 8, at + 4, f"{value:g}", "end"))
    return lines


def stroke(start, end, at, colour, dashes):
    """A horizontal line."""
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    return f'<line x1="{start}" y1="{at:.1f}" x2="{end}" y2="{at:.1f}" stroke="{colour}" stroke-width="2"{dashed}/>'


def drawn(line, colour, x, y):
    places = [(x.at(p.seconds), y.at(p.ratio)) for p in line.points]
    path = " ".join(f"{px:.1f},{py:.1f}" for px, py in places)
    out = [f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'] if len(places) > 1 else []
    for (px, py), point in zip(places, line.points):
        words = f"{point.label} {point.ratio:.3f}, {point.seconds:.3g} s"
        out.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="4.5" fill="{colour}"/>')
        # Above, as lines fall to the right; points in the right third have theirs on the left, so that it stays inside.
        leftwards = px > LEFT + (WIDTH - RIGHT - LEFT) * 2 / 3
        out.append(text(px - 9 if leftwards else px + 8, py - 6, words, "end" if leftwards else "start", colour, 12))
    return out


def legend(index, name, colour, dashes):
    at, left = TOP + 14 + 20 * index, WIDTH - RIGHT + 14
    return [stroke(left, left + 26, at - 4, colour, dashes), text(left + 33, at, name, colour=colour)]
