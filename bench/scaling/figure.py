"""Memory and time against pixels, both logarithmic, as a plain SVG of two panels."""

from ..plot import COLOURS, Axis, document, grid, text

WIDTH, HEIGHT = 1080, 480
PANEL, LEFT, GAP, TOP, BOTTOM = 420, 70, 110, 60, 60
GIB = 1 << 30
NAMES = {"fit": "sspc-train fit --preset fast", "run": "sspc-infer run"}


def svg(results):
    """The plot's text; frames whose run failed are left out."""
    good = [result for result in results if not result["failure"]]
    panels = [
        ("peak memory, GiB (log)", lambda result: result["peak_rss_bytes"] / GIB),
        ("core-seconds, file to file (log)", lambda result: result["cpu_seconds"]),
    ]
    body = []
    if good:
        for index, (name, value) in enumerate(panels):
            body += panel(LEFT + index * (PANEL + GAP), name, value, good)
    return document(WIDTH, HEIGHT, body)


def megapixels(result):
    return result["width"] * result["height"] / 1e6


def panel(left, name, value, results):
    right, bottom = left + PANEL, HEIGHT - BOTTOM
    x = Axis([megapixels(result) for result in results], left, right)
    y = Axis([value(result) for result in results], bottom, TOP)
    out = grid(x, y, left, TOP, right, bottom)
    out.append(text((left + right) / 2, HEIGHT - 20, "megapixels (log)", "middle"))
    out.append(text(left, TOP - 30, name, size=15))
    for index, program in enumerate(dict.fromkeys(result["program"] for result in results)):
        own = [result for result in results if result["program"] == program]
        out += line(own, value, x, y, COLOURS[index % len(COLOURS)])
        out.append(text(left + 10, TOP + 18 + 18 * index, NAMES[program], colour=COLOURS[index % len(COLOURS)]))
    return out


def line(results, value, x, y, colour):
    places = [(x.at(megapixels(result)), y.at(value(result)), value(result)) for result in results]
    path = " ".join(f"{px:.1f},{py:.1f}" for px, py, _ in places)
    out = [f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'] if len(places) > 1 else []
    for px, py, number in places:
        out.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="4.5" fill="{colour}"/>')
        out.append(text(px, py - 9, f"{number:.3g}", "middle", colour, 12))
    return out
