"""Predicted against true values on log axes, a panel for errors and one for gains, as a plain SVG."""

from xml.sax.saxutils import escape

from . import calibration
from .plot import COLOURS, Axis, document, text

WIDTH, HEIGHT = 1080, 560
TOP, BOTTOM, SIDE = 80, 490, 410
# Left edges of the panels.
LEFTS = (80, 610)
MARKS = {calibration.DENOISED: COLOURS[1], calibration.CORRECTED: COLOURS[0], calibration.GAIN: COLOURS[2]}


def svg(title, subtitle, predictions):
    """The plot's text; None where no truth is above 0."""
    panels = [
        ("relL2 of the picture", [p for p in predictions if p.what != calibration.GAIN and p.truth > 0]),
        ("gain in relL2", [p for p in predictions if p.what == calibration.GAIN and p.truth > 0]),
    ]
    if not any(points for _, points in panels):
        return None
    body = [text(LEFTS[0], 28, title, size=17), text(LEFTS[0], 48, subtitle, colour="#555", size=12)]
    for left, (name, points) in zip(LEFTS, panels):
        if points:
            body += panel(left, name, points)
    return document(WIDTH, HEIGHT, body)


def panel(left, name, points):
    """One panel: both axes over one range, the diagonal on which prediction and truth agree."""
    values = [p.truth for p in points] + [p.predicted for p in points if p.predicted > 0]
    x, y = Axis(values, left, left + SIDE), Axis(values, BOTTOM, TOP)
    out = [f'<rect x="{left}" y="{TOP}" width="{SIDE}" height="{BOTTOM - TOP}" fill="none" stroke="#888"/>']
    for tick in x.ticks():
        out.append(line(x.at(tick), TOP, x.at(tick), BOTTOM, "#e5e5e5"))
        out.append(line(left, y.at(tick), left + SIDE, y.at(tick), "#e5e5e5"))
        out.append(text(x.at(tick), BOTTOM + 18, f"{tick:g}", "middle", size=11))
        out.append(text(left - 6, y.at(tick) + 4, f"{tick:g}", "end", size=11))
    out.append(line(left, BOTTOM, left + SIDE, TOP, "#666", ' stroke-dasharray="8 4"'))
    for p in points:
        out += mark(p, x, y)
    out.append(text(left + SIDE / 2, BOTTOM + 42, f"true {name} (log)", "middle"))
    middle = (TOP + BOTTOM) / 2
    turned = f' transform="rotate(-90 {left - 54} {middle:.1f})"'
    out.append(text(left - 54, middle, "predicted (log)", "middle", extra=turned))
    for index, what in enumerate(dict.fromkeys(p.what for p in points)):
        out.append(text(left + 10, TOP + 18 + 18 * index, what, colour=MARKS[what], size=12))
    return out


def mark(p, x, y):
    """A point with its standard error; at the lower border, a triangle, where the prediction is 0 or below."""
    colour, at, clamp = MARKS[p.what], x.at(p.truth), lambda v: min(max(v, TOP), BOTTOM)
    words = f"{p.frame}, {p.column}: predicted {p.predicted:.3g}, true {p.truth:.3g}"
    label = f"<title>{escape(words)}</title>"
    if p.predicted <= 0:
        corners = f"{at - 5:.1f},{BOTTOM - 10} {at + 5:.1f},{BOTTOM - 10} {at:.1f},{BOTTOM}"
        return [f'<polygon points="{corners}" fill="none" stroke="{colour}">{label}</polygon>']
    out = []
    if p.standard_error:
        low, high = p.predicted - p.standard_error, p.predicted + p.standard_error
        out.append(line(at, clamp(y.at(low)) if low > 0 else BOTTOM, at, clamp(y.at(high)), colour))
    return [
        *out,
        f'<circle cx="{at:.1f}" cy="{y.at(p.predicted):.1f}" r="4" fill="{colour}" fill-opacity="0.6">{label}</circle>',
    ]


def line(x1, y1, x2, y2, colour, extra=""):
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}"{extra}/>'
