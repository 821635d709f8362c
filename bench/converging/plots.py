"""The two figures, by matplotlib."""

from .frames import LABELS

COLOURS = ("#1f4e9c", "#b0462a", "#2c7a3f", "#7a3f8f")


def by_samples(found, title, path):
    """relL2 against samples per pixel, both logarithmic: noisy, and each denoiser without and with correction."""
    figure, axes = canvas()
    first = next(iter(found.values()))
    axes.plot(
        list(first), [f["noisy"] for f in first.values()], color="#606060", linestyle=":", marker=".", label="noisy"
    )
    for colour, (denoiser, figures) in zip(COLOURS, found.items()):
        counts = list(figures)
        for what, style in (("denoised", "--"), ("corrected", "-")):
            label = f"{LABELS[denoiser]}{', corrected' if what == 'corrected' else ''}"
            values = [f[what] for f in figures.values()]
            axes.plot(counts, values, color=colour, linestyle=style, marker="o", markersize=4, label=label)
    axes.set_xscale("log", base=2)
    axes.set_xticks(list(first), [str(count) for count in first])
    finish(figure, axes, title, "samples per pixel", path)


def by_steps(found, title, path):
    """relL2 against training steps for each combination function, with the denoiser's as a line."""
    figure, axes = canvas()
    for colour, (name, figures) in zip(COLOURS, found.items()):
        values = [f["corrected"] for f in figures.values()]
        axes.plot(
            [f["steps"] for f in figures.values()], values, color=colour, marker="o", markersize=4, label=f"${name}$"
        )
    one = next(iter(next(iter(found.values())).values()))
    axes.axhline(one["denoised"], color="#606060", linestyle="--", label="denoised")
    axes.set_xscale("log")
    counts = sorted({f["steps"] for figures in found.values() for f in figures.values()})
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.set_xticks([], minor=True)
    finish(figure, axes, title, "training steps", path)


def canvas():
    import matplotlib

    matplotlib.use("svg")
    # The same figures give the same file.
    matplotlib.rcParams["svg.hashsalt"] = "sspc"
    from matplotlib import pyplot

    return pyplot.subplots(figsize=(6.4, 4.4), layout="constrained")


def finish(figure, axes, title, x, path):
    axes.set_yscale("log")
    axes.set_xlabel(x)
    axes.set_ylabel("relL2")
    axes.set_title(title, fontsize=10)
    axes.grid(True, which="major", color="#d0d0d0", linewidth=0.6)
    # Long enough to tell dashes from a line.
    axes.legend(fontsize=8, handlelength=3.5)
    for kind in (".svg", ".png"):
        metadata = {"Date": None} if kind == ".svg" else {}
        figure.savefig(path.with_suffix(kind), dpi=150, metadata=metadata)
