"""The record: all figures as JSON, tables as Markdown, plots as SVG."""

import json
from dataclasses import asdict
from pathlib import Path

from . import calibration, equal_time, figures, goals, plot, same_work, scatter, shots
from .jobs import SSPC


class Record:
    """Figures of one benchmark. `about`: machine, commit, programs, command, settings, how it ended."""

    def __init__(self, about, frames, columns, results, render_seconds, of_shots=()):
        self.about = about
        self.frames = frames
        # (heading, method, preset) in the order of the methods.
        self.columns = columns
        self.results = results
        self.render_seconds = render_seconds
        # Results of shots as wholes.
        self.shots = list(of_shots)
        self.rows = figures.rows(results, frames)
        self.cells = figures.cells(results)

    def write(self, folder):
        """Writes DATE-COMMIT.md, .json and, with points to plot, .svg beside earlier records; their paths."""
        stem = free_stem(folder, name_of(self.about))
        pictures = {f"{stem}{suffix}": picture for suffix, picture in self.pictures().items() if picture}
        return write_all(folder, {f"{stem}.md": self.markdown(stem, pictures), f"{stem}.json": self.json()} | pictures)

    def dirty(self, word):
        return word if self.about["commit"]["dirty"] else ""

    def json(self):
        verdicts = [asdict(v) for preset in self.rated() for v in self.verdicts(preset)]
        frames = [{"name": f.name, "spp": f.spp, "other_denoising": f.variant, "shot": f.shot} for f in self.frames]
        means = {heading: self.mean_ratio(heading) for heading, _, _ in self.columns}
        everything = self.about | {
            "frames": frames,
            "geometric_means": means,
            "goals": verdicts,
            "equal_time": self.equal_times(),
            "same_work": same_work.figures(self),
            "results": self.results,
            "shots": self.shots,
        }
        return json.dumps(everything, indent=1) + "\n"

    def pictures(self):
        """Plots by the suffix of their names, None for one without a point.

        `.svg`: the columns that all frames of the mean have. `-all.svg`, where that leaves out columns: all columns,
        over the frames that all have. `-estimates.svg`: the predictions.
        """
        judged = figures.judged(self.frames)
        measured = [c for c in self.columns if any((f.name, c[0]) in self.cells for f in self.frames)]
        whole = [c for c in measured if not figures.lacking(judged, self.cells, c[0])]
        common = [f for f in self.frames if all(self.ratio(f.name, c[0]) is not None for c in measured)]
        predictions = calibration.predictions(self.results)
        return {
            ".svg": self.svg(whole, judged) if whole else self.svg(measured, common),
            "-all.svg": self.svg(measured, common) if whole and len(whole) < len(measured) else None,
            "-estimates.svg": scatter.svg("Predicted and true error", self.subtitle(""), predictions),
        }

    def subtitle(self, frames):
        return f"{frames}{self.short_machine()}; {self.about['commit']['hash']}{self.dirty(' and changes')}"

    def svg(self, columns, over):
        """None without a single point."""
        of_method = {}
        for heading, method, preset in columns:
            point = self.point(heading, preset, over)
            if point:
                of_method.setdefault(method, []).append(point)
        series = [plot.Series(method, tuple(points)) for method, points in of_method.items()]
        if not series:
            return None
        levels = [plot.Level("denoiser, full buffer", 1.0)]
        mix = figures.mean_over(over, lambda f: self.mix_ratio(f.name))
        if mix is not None and mix < 0.9995:
            levels.append(plot.Level("best fixed mix", mix))
        noisy = figures.mean_over(over, lambda f: self.rows[f.name].ratio(self.rows[f.name].noisy))
        names = f": {over[0].name}" if len(over) == 1 else ""
        subtitle = self.subtitle(f"geometric mean over {self.count(over)}{names}; ")
        notes = [f"noisy, above the axis {noisy:.3g}"] if noisy else []
        return plot.svg("Error against time", subtitle, series, levels, notes)

    def point(self, heading, preset, over):
        known = [f for f in over if (f.name, heading) in self.cells]
        ratio = figures.mean_over(known, lambda f: self.ratio(f.name, heading))
        if ratio is None:
            return None
        return plot.Point(preset, figures.mean_over(known, lambda f: self.cells[f.name, heading].seconds), ratio)

    def count(self, frames):
        names = {frame.shot or frame.name for frame in frames}
        return "1 frame" if len(names) == 1 else f"{len(names)} frames"

    def ratio(self, name, heading):
        return goals.ratio_of(self.cells, name, heading)

    def mix_ratio(self, name):
        row = self.rows.get(name)
        return row.ratio(row.mix) if row else None

    def mean_ratio(self, heading, frames=None):
        frames = figures.judged(self.frames) if frames is None else frames
        return figures.mean_over(frames, lambda f: self.ratio(f.name, heading))

    def rated(self):
        """Presets to be held against the goals: not those of a shortened trial."""
        if self.about["steps_limit"]:
            return []
        return [preset for _, method, preset in self.columns if method == SSPC and preset in goals.GOALS]

    def verdicts(self, preset):
        return goals.verdicts(preset, self.frames, self.rows, self.cells)

    def short_machine(self):
        machine = self.about["machine"]
        return f"{machine['processor']}, {machine['cores_usable']} cores"

    def markdown(self, stem, pictures):
        commit, of_shots = self.about["commit"]["hash"], shots.text(self.shots, table)
        parts = [
            f"# Benchmark of {self.about['date'][:10]}, commit {commit}{self.dirty(' with changes')}",
            self.failures(),
            self.about_text(),
            *(self.frame_parts(stem, pictures) if self.results else ()),
            "## Shots as wholes\n\n" + of_shots if of_shots else "",
        ]
        return "\n\n".join(part for part in parts if part) + "\n"

    def frame_parts(self, stem, pictures):
        def image(name, suffix):
            return f"![{name}]({stem}{suffix})" if stem + suffix in pictures else ""

        estimates, same = f"{stem}-estimates.svg", same_work.text(self, table)
        return [
            image("relL2 against seconds", ".svg"),
            image("relL2 against seconds, every method, on the frames that all were run on", "-all.svg"),
            "## Goals\n\n" + self.goals_table(),
            "## relL2 ÷ the denoiser's\n\n" + self.ratio_table(),
            "## The same across the reference's halves\n\n" + self.crossed_table(),
            "## Mean brightness\n\n" + self.brightness_table(),
            "## Seconds, file to file\n\n" + self.seconds_table(),
            "## Where the seconds go\n\n" + self.split_table(),
            "## The same work in PyTorch\n\n" + same if same else "",
            "## Equal error, equal time\n\n" + self.equal_time_text(),
            "## Predicted and true error\n\n"
            + calibration.text(self.results, table, estimates if estimates in pictures else None),
        ]

    def failures(self):
        failed = [r for r in self.results if r["failure"]]
        lines = [f"- {r['frame']}, {r['column']}, seed {r['seed']}: {r['failure']}" for r in failed]
        lines += [f"- {shots.line(result)}" for result in self.shots if result["failure"]]
        lines += [f"- {problem}" for problem in self.about["problems"]]
        return "\n".join(["**Problems:**", *lines]) if lines else ""

    def about_text(self):
        about, machine = self.about, self.about["machine"]
        memory = f"{machine['memory_bytes'] / 2**30:.1f} GiB" if machine["memory_bytes"] else "unknown"
        threads = sorted({r["threads"] for r in figures.succeeded([*self.results, *self.shots]) if r.get("threads")})
        lines = [
            f"- Machine: {machine['processor']}; {machine['cores_usable']} of {machine['cores_present']} cores usable, "
            f"{' and '.join(map(str, threads)) or 'unknown'} threads used; memory {memory}; {machine['system']}",
            f"- Load average (1, 5, 15 min) before {spaced(machine['load_average_before'])}, "
            f"after {spaced(about['load_average_after'])}; other load is part of the seconds below",
            f"- Commit {about['commit']['hash']}{self.dirty(', working tree changed')}; "
            + "; ".join(f"{p['name']} built {p['built']} (SHA-256 {p['sha256']}…)" for p in about["programs"]),
            f"- Command: `{about['command']}`",
            f"- {about['date']}, {about['ended']}: {len(self.results) + len(self.shots)} of {about['planned']} runs",
        ]
        return "\n".join(lines)

    def goals_table(self):
        if self.about["steps_limit"]:
            return f"Not judged: a trial of {self.about['steps_limit']} steps per fit."
        verdicts = [v for preset in self.rated() for v in self.verdicts(preset)]
        if not verdicts:
            return "Not judged: no preset that has goals was run."
        over = figures.judged(self.frames)
        note = (
            f"Means are geometric, over {self.count(over)} with a reference, as denoised (without other denoisings of "
            "the same halves; the frames of a shot count as one); the worst is over every frame and denoising. The "
            "goals are for two cores."
        )
        body = [[v.preset, v.what, v.goal, v.found, v.word] for v in verdicts]
        return note + "\n\n" + table(["preset", "what", "goal", "found", ""], body)

    def ratio_table(self):
        headings = [heading for heading, _, _ in self.columns]
        body = []
        for frame in self.frames:
            row = self.rows.get(frame.name)
            if not row or row.denoised is None:
                continue
            figures_of = [number(row.ratio(row.noisy), 1), number(row.denoised, 5), number(self.mix_ratio(frame.name))]
            body.append([frame.name, *figures_of, *(self.ratio_text(frame.name, h) for h in headings)])
        if not body:
            return "No frame with a reference."
        judged = figures.judged(self.frames)
        measured = [frame for frame in self.frames if frame.reference and frame.name in self.rows]
        body.append(self.mean_row(f"**geometric mean, {self.count(judged)}**", judged))
        if len(measured) > len(judged):
            body.append(self.mean_row("geometric mean, every row (a shot as one)", measured))
        body.append(["**worst frame**", "", "", "", *(self.worst_text(h) for h in headings)])
        note = (
            "All columns but `denoised` are ratios to the denoiser's relL2 on the full buffer. mix: the best fixed mix "
            "of noisy and denoised. = : the output is the denoiser's (fallback)."
        )
        return note + "\n\n" + table(["frame", "noisy", "denoised (absolute)", "mix", *headings], body)

    def crossed(self, name, heading):
        cell = self.cells.get((name, heading))
        return cell.crossed if cell else None

    def crossed_table(self):
        headings = [heading for heading, _, _ in self.columns]
        rows = [frame for frame in self.frames if any(self.crossed(frame.name, h) is not None for h in headings)]
        if not rows:
            return "Not measured."
        body = [[frame.name, *(number(self.crossed(frame.name, h)) for h in headings)] for frame in rows]
        over = [frame for frame in figures.judged(self.frames) if frame in rows]
        means = [figures.mean_over(over, lambda f, h=h: self.crossed(f.name, h)) for h in headings]
        body.append([f"**geometric mean, {self.count(over)}**", *map(number, means)])
        note = (
            "The denominator of relL2 contains the reference's noise: a pixel that is dark by chance counts more, "
            "which favours pictures that are too dark. Here each half of the reference is the target under the "
            "denominator of the other half, so the gain over the denoised picture is unbiased."
        )
        return note + "\n\n" + table(["frame", *headings], body)

    def brightness_table(self):
        headings = [heading for heading, _, _ in self.columns]

        def cells_of(frame):
            return [self.cells.get((frame.name, heading)) for heading in headings]

        body = []
        for frame in self.frames:
            known = [cell for cell in cells_of(frame) if cell and cell.denoised_brightness is not None]
            if known:
                corrected = [percent(cell and cell.brightness) for cell in cells_of(frame)]
                body.append([frame.name, percent(known[0].denoised_brightness), *corrected])
        note = "Mean radiance of the picture relative to the reference, in per cent; negative is darker."
        return note + "\n\n" + table(["frame", "denoised", *headings], body) if body else "Not measured."

    def mean_row(self, title, frames):
        mix = number(figures.mean_over(frames, lambda f: self.mix_ratio(f.name)))
        return [title, "", "", mix, *(self.mean_text(frames, heading) for heading, _, _ in self.columns)]

    def mean_text(self, frames, heading):
        """The mean, and how many of the frames it lacks."""
        lacking = figures.lacking(frames, self.cells, heading)
        mean = number(self.mean_ratio(heading, frames))
        return f"{mean} ({lacking} of {len(frames)} lacking)" if lacking and mean != "-" else mean

    def ratio_text(self, name, heading):
        cell = self.cells.get((name, heading))
        if cell is None or cell.ratio is None:
            return "-"
        return number(cell.ratio) + (" =" if cell.fallback else "")

    def worst_text(self, heading):
        worst = figures.worst(self.frames, self.cells, heading)
        return f"{worst[0]:.3f} {worst[1]}" if worst else "-"

    def seconds_table(self):
        headings = [heading for heading, _, _ in self.columns]
        body = []
        for frame in self.frames:
            row = self.rows.get(frame.name)
            if row:
                cells = (self.seconds_text(frame.name, h) for h in headings)
                body.append([frame.name, f"{row.pixels / 1000:.0f} k", *cells])
        note = (
            "Wall clock of the whole process, median of the runs (minimum to maximum); processor seconds of all "
            "threads; peak memory; steps."
        )
        return note + "\n\n" + table(["frame", "pixels", *headings], body)

    def seconds_text(self, name, heading):
        cell = self.cells.get((name, heading))
        if cell is None:
            return "-"
        least, most = cell.least_seconds, cell.most_seconds
        spread = f" ({least:.2f} to {most:.2f})" if most > least else ""
        steps = f", {cell.steps} steps" if cell.steps is not None else ""
        return f"{cell.seconds:.2f}{spread}, cpu {cell.cpu_seconds:.1f}, {cell.peak_rss_bytes / 2**20:.0f} MiB{steps}"

    def split_table(self):
        """Mean seconds of the stages, as the program reports them, over the runs of a column."""
        stages, body = ("read", "train", "correct", "write", "total"), []
        timed = [result for result in figures.succeeded(self.results) if result.get("seconds")]
        for heading, _, _ in self.columns:
            splits = [result["seconds"] for result in timed if result["column"] == heading]
            if splits:
                means = [sum(split.get(stage, 0.0) for split in splits) / len(splits) for stage in stages]
                body.append([heading, *(f"{value:.2f}" for value in means)])
        return table(["mean over the runs", *stages], body) if body else "Not reported by any run."

    def equal_times(self):
        """Figures for every frame and column whose render time is known."""
        out = []
        for frame in self.frames:
            row, seconds = self.rows.get(frame.name), self.render_seconds(frame.name)
            if row is None or seconds is None or not row.noisy or not row.denoised:
                continue
            ladder = [
                (f.spp, self.rows[f.name].denoised)
                for f in self.frames
                if f.scene == frame.scene and f.variant == frame.variant and f.name in self.rows
            ]
            for heading, _, _ in self.columns:
                ratio, cell = self.ratio(frame.name, heading), self.cells.get((frame.name, heading))
                if ratio is not None:
                    bought = equal_time.equal_time(row.noisy, frame.spp, seconds, cell.seconds, ladder)
                    about = {"frame": frame.name, "column": heading, "render_seconds": seconds}
                    out.append(about | {"corrected": ratio * row.denoised} | asdict(bought))
        return out

    def equal_time_text(self):
        figures_of = self.equal_times()
        needed = equal_time.text(self, table)
        if not figures_of:
            return needed
        note = (
            "What the column's seconds would buy as samples: the noisy picture's relL2 falls with 1 / samples; the "
            "denoiser's is interpolated in log-log between the sample counts of the scene (- with only one). All relL2 "
            "absolute."
        )
        headings = ["frame", "column", "render s", "samples ×", "noisy then", "denoised then", "corrected"]
        body = []
        for e in figures_of:
            errors = [number(e[key], 5) for key in ("noisy", "denoised", "corrected")]
            body.append([e["frame"], e["column"], f"{e['render_seconds']:g}", number(e["factor"], 2), *errors])
        return needed + "\n\n" + note + "\n\n" + table(headings, body)


def number(value, digits=3):
    return "-" if value is None else f"{value:.{digits}f}"


def percent(ratio):
    return "-" if ratio is None else f"{100 * (ratio - 1):+.2f}"


def spaced(values):
    return " ".join(f"{value:.1f}" for value in values)


def table(headings, body):
    """A Markdown table; bars within cells are escaped."""
    lines = [headings, ["---"] * len(headings), *body]
    return "\n".join("| " + " | ".join(str(c).replace("|", "\\|") for c in line) + " |" for line in lines)


def name_of(about):
    """DATE-COMMIT, and -dirty where the working tree was changed."""
    commit = about["commit"]
    return f"{about['date'][:10]}-{commit['hash']}" + ("-dirty" if commit["dirty"] else "")


def write_all(folder, texts):
    """Writes files by their names; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text)
    return [folder / name for name in texts]


def free_stem(folder, stem):
    """The stem, or stem-2, stem-3 ... where a record of that name exists: records are never overwritten."""
    stems, count = {path.stem for path in Path(folder).glob("*")}, 1
    candidate = stem
    while candidate in stems:
        count += 1
        candidate = f"{stem}-{count}"
    return candidate
