"""The paper's schedule in PyTorch and in our preset `paper`, which do the same work, beside `balanced`."""

from .jobs import PAPER, TORCH

BALANCED = "balanced"
COLUMNS = (TORCH, PAPER, BALANCED)

NOTE = (
    "PyTorch and the preset `paper` run the same schedule (network, patches, batches, epochs, rate) from different "
    "random weights, so their pictures differ as those of two seeds do, and the ratio of their processor seconds is "
    "the speed-up of the same work. Processor seconds are user and system seconds of the whole process, files and "
    "start-up included."
)


def figures(record):
    """One line per column and frame that PyTorch was run on, each relative to PyTorch on that frame."""
    out = []
    for frame in record.frames:
        theirs = record.cells.get((frame.name, TORCH))
        if theirs is None or theirs.ratio is None:
            continue
        for heading in COLUMNS:
            cell = record.cells.get((frame.name, heading))
            if cell is not None and cell.ratio is not None:
                out.append(
                    {
                        "frame": frame.name,
                        "column": heading,
                        "ratio": cell.ratio,
                        "cpu_seconds": cell.cpu_seconds,
                        "wall_seconds": cell.seconds,
                        "peak_rss_bytes": cell.peak_rss_bytes,
                        "ratio_to_torch": cell.ratio / theirs.ratio,
                        "times_faster": theirs.cpu_seconds / cell.cpu_seconds,
                    }
                )
    return out


def text(record, table):
    """The section's text, empty where PyTorch was not run; `table` makes a Markdown table."""
    found = figures(record)
    if not found:
        return ""
    headings = ["frame", "", "relL2 ÷ denoiser's", "÷ PyTorch's", "cpu s", "PyTorch's cpu s ÷ these", "wall s", "MiB"]
    body = []
    for f in found:
        errors = [f"{f['ratio']:.3f}", f"{f['ratio_to_torch']:.2f}"]
        times = [f"{f['cpu_seconds']:.1f}", f"{f['times_faster']:.1f}", f"{f['wall_seconds']:.1f}"]
        body.append([f["frame"], f["column"], *errors, *times, f"{f['peak_rss_bytes'] / 2**20:.0f}"])
    return f"{NOTE}\n\n{table(headings, body)}"
