"""The record: a table, the figures as JSON, a plot."""

import json
from datetime import datetime

from .figure import svg

GIB = 1 << 30
# Memory bounds of this project for 4K and 8K; 8 GiB for fit are about 250 bytes per pixel.
BOUNDS = {
    ("run", 3840 * 2160): 2 * GIB,
    ("run", 7680 * 4320): 4 * GIB,
    ("fit", 3840 * 2160): 2 * GIB,
    ("fit", 7680 * 4320): 8 * GIB,
}
NAMES = {"fit": "`sspc-train fit --preset fast`", "run": "`sspc-infer run`"}


def bound(result):
    return BOUNDS.get((result["program"], result["width"] * result["height"]))


def too_much(result):
    limit = bound(result)
    return bool(limit and not result["failure"] and result["peak_rss_bytes"] > limit)


def sentence(result):
    """A progress line."""
    size = f"{result['program']} {result['width']} x {result['height']}"
    if result["failure"]:
        return f"{size}: FAILED: {result['failure']}"
    memory = f"{result['peak_rss_bytes'] / GIB:.2f} GiB"
    return f"{size}: {result['wall_seconds']:.1f} s, {result['cpu_seconds']:.1f} core-s, {memory}"


def write(folder, about, results):
    """Writes the record's three files; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    day = datetime.fromisoformat(about["date"]).date().isoformat()
    stem = f"scale-{day}-{about['commit']['hash']}{'-dirty' if about['commit']['dirty'] else ''}"
    texts = {
        ".json": json.dumps({"about": about, "results": results}, indent=1) + "\n",
        ".md": markdown(about, results, stem),
        ".svg": svg(results),
    }
    paths = [folder / (stem + ending) for ending in texts]
    for path, text in zip(paths, texts.values()):
        path.write_text(text)
    return paths


def markdown(about, results, stem):
    host, changed = about["machine"], ", changed" if about["commit"]["dirty"] else ""
    lines = [
        f"# Time and memory against the size of the frame, {about['date'][:10]}",
        "",
        f"Command `{about['command']}`, commit {about['commit']['hash']}{changed}. "
        f"{host['processor']}, {host['cores_usable']} cores usable, {host['system']}; "
        f"load average {host['load_average_before'][0]} before, {about['load_average_after'][0]} after.",
        "",
        f"![memory and time against pixels]({stem}.svg)",
        "",
        "| program | size | megapixels | seconds | core-seconds | peak memory, GiB | bytes per pixel | bound, GiB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *map(row, results), "", *splits(results), ""])


def row(result):
    pixels = result["width"] * result["height"]
    head = f"| {NAMES[result['program']]} | {result['width']} x {result['height']} | {pixels / 1e6:.2f} |"
    if result["failure"]:
        return f"{head} failed: {result['failure']} | | | | |"
    peak = result["peak_rss_bytes"]
    limit = bound(result)
    verdict = "" if not limit else f"{limit / GIB:.0f}, {'MISSED' if too_much(result) else 'kept'}"
    figures = [
        f"{result['wall_seconds']:.1f}",
        f"{result['cpu_seconds']:.1f}",
        f"{peak / GIB:.2f}",
        f"{peak / pixels:.0f}",
        verdict,
    ]
    return head + " " + " | ".join(figures) + " |"


def splits(results):
    """Wall time by stage, as the programs report it."""
    lines = ["Seconds by stage, as reported by the programs:", ""]
    for result in results:
        if not result["failure"] and result.get("seconds"):
            parts = ", ".join(f"{name} {value:.2f}" for name, value in result["seconds"].items())
            steps = f" ({result['steps']} steps)" if result.get("steps") else ""
            lines.append(f"- {result['program']} {result['width']} x {result['height']}: {parts}{steps}")
    return lines
