"""How tables are written: Markdown rows, means with their intervals, differences in bold where a peer is better."""

OURS = ("interslice", "interslice --method field", "interslice morph alone")
SHORT = {"napari-label-interpolator": "napari-label-...", "napari-nD-annotator": "napari-nD-..."}


def table(head, rows):
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows])


def spread(found, digits, factor=1.0, sign=False):
    """Mean and half of its interval's width."""
    value, low, high = (factor * v for v in found)
    return f"{value:{'+' if sign else ''}.{digits}f} ± {(high - low) / 2:.{digits}f}"


def between(found, digits, factor=1.0, interval=True):
    """Mean and interval of a difference; bold where the peer is better."""
    value, low, high = (round(factor * v, digits) + 0.0 for v in found)
    words = f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]" if interval else f"{value:.{digits}f}"
    return f"**{words}**" if value < 0 else words


def named(program):
    """A program's name in a table's first column."""
    return f"`{program}`" if program == "interslice" or program.startswith("interslice --") else program
