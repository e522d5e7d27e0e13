"""A drawing as a file: SVG, or PNG for a name that says so."""

from __future__ import annotations

import os


def write_drawing(drawing: str, path: str) -> None:
    """drawing: the SVG text of it; path: ending in .png for PNG, "-" is standard output. Raises DataError without what
    PNG needs, OSError."""
    from enginediag_cli.progress import wipe
    from enginediag_cli.recordings.write import binary_output, output

    if os.path.splitext(path.lower())[1] == ".png":
        from enginediag_cli.presentation.pictures.png import png

        data = png(drawing, path)
        with binary_output(path) as raw:
            wipe()
            raw.write(data)
        return
    with output(path) as stream:
        wipe()
        stream.write(drawing)
