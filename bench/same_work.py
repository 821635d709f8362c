"""The paper's schedule in PyTorch and in our preset `paper`, which do the same work, and what `balanced` makes of less."""

from .jobs import PAPER, TORCH

BALANCED = "balanced"
COLUMNS = (TORCH, PAPER, BALANCED)

NOTE = (
    "PyTorch and the preset `paper` carry out the same schedule (network, patches, batches, epochs, rate) from random weights of their own, so their "
    "pictures differ as those of two seeds do, and the ratio of their processor seconds says how much faster the same work is done. Processor seconds "
    "are user and system seconds of the whole process, files and start-up included."
)


def figures(record):
    """A line for every frame and column of those that PyTorch was run on, each against PyTorch on that frame."""
    out = []
    for frame in record.frames:
        theirs = record.cells.get((frame.name, TORCH))
        if theirs is None or theirs.ratio is None:
            continue
        for heading in COLUMNS:
            cell = record.cells.get((frame.name, heading))
            if cell is not None and cell.ratio is not None:
                out.append({
                    "frame": frame.name,
                    "column": heading,
                    "ratio": cell.ratio,
                    "cpu_seconds": cell.cpu_seconds,
                    "wall_seconds": cell.seconds,
                    "peak_rss_bytes": cell.peak_rss_bytes,
                    "ratio_to_torch": cell.ratio / theirs.ratio,
                    "times_faster": theirs.cpu_seconds / cell.cpu_seconds,
                })
    return out


def text(record, table):
    """The section's text, empty where PyTorch was not run; `table` makes a Markdown table."""
    found = figures(record)
    if not found:
        return ""
    headings = ["frame", "", "relL2 ÷ denoiser's", "÷ PyTorch's", "cpu s", "PyTorch's cpu s ÷ these", "wall s", "MiB"]
    body = [
        [f["frame"], f["column"], f"{f['ratio']:.3f}", f"{f['ratio_to_torch']:.2f}", f"{f['cpu_seconds']:.1f}", f"{f['times_faster']:.1f}",
         f"{f['wall_seconds']:.1f}", f"{f['peak_rss_bytes'] / 2**20:.0f}"]
        for f in found
    ]  # fmt: skip
    return f"{NOTE}\n\n{table(headings, body)}"
