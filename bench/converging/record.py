"""The text of a record of bench/convergence."""

from ..record import table
from . import equal

STEPS = "every row is a training of its own of that many steps, its rate schedule included."
EQUAL = """\
Left: so many samples, three pictures denoised (both halves and the full buffer), corrected. Right: what the same
processor seconds give as samples with one picture denoised. ~ : extrapolated beyond the counts measured."""


def markdown(options, about, results, stem):
    """Head, figures and tables of every scene; `stem` names the figures' files."""
    parts = [*head(options, about)]
    for scene, found in results.items():
        parts += [f"## {scene}", f"![samples]({stem}-{scene}-samples.svg) ![steps]({stem}-{scene}-steps.svg)"]
        parts += ["### Samples", samples(found["samples"])]
        parts += [
            "### Steps",
            f"{options.steps_spp} spp, {options.denoisers[0]}, {options.steps_preset}; {STEPS}",
            steps(found["steps"]),
        ]
        parts += ["### Equal time", EQUAL, equal_times(equal.rows(found["samples"], found["seconds"]))]
    return "\n\n".join(parts)


def head(options, about):
    commit, machine = about["commit"], about["machine"]
    changed = ", changed sources" if commit["dirty"] else ""
    yield f"# bench/convergence, {about['date'][:10]}, {commit['hash']}{changed}"
    yield f"`{about['command']}`"
    yield (
        f"{machine['processor']}, {machine['cores_usable']} cores, {machine['system']}; load before "
        f"{machine['load_average_before']}, after {about['load_average_after']}. Seconds are processor seconds, of the "
        "rendering process, of the denoiser and of the whole fit from file to file, so that what else runs on the "
        "machine counts little; starting the renderer is left out. relL2 against references of "
        f"{options.reference_spp} samples, their own noise taken out. Ratio: corrected divided by denoised."
    )
    if max(machine["load_average_before"][0], about["load_average_after"][0]) > machine["cores_usable"]:
        yield "The machine was shared while this was measured (load above its cores): seconds are rough."


def samples(found):
    heads = ["denoiser", "spp", "noisy", "denoised", "corrected", "ratio"]
    body = [
        [denoiser, spp, *(f"{f[key]:.3g}" for key in ("noisy", "denoised", "corrected")), ratio(f)]
        for denoiser, figures in found.items()
        for spp, f in figures.items()
    ]
    return table(heads, body)


def steps(found):
    heads = ["function", "steps", "relL2", "ratio", "seconds"]
    body = [
        [name, f["steps"], f"{f['corrected']:.3g}", ratio(f), f"{f['seconds']:.1f}"]
        for name, figures in found.items()
        for f in figures.values()
    ]
    return table(heads, body)


def equal_times(rows):
    heads = ["denoiser", "spp", "seconds", "corrected", "spp without correction", "denoised", "ratio"]
    return table(heads, [equal_time(row) for row in rows])


def equal_time(row):
    cells = [row.denoiser, row.spp, f"{row.seconds:.1f}", f"{row.corrected:.3g}", f"{row.other_spp:.0f}"]
    if row.denoised is None:
        return [*cells, "-", "-"]
    return [*cells, f"{'~' if row.extrapolated else ''}{row.denoised:.3g}", f"{row.corrected / row.denoised:.2f}"]


def ratio(figures):
    return f"{figures['corrected'] / figures['denoised']:.2f}"
