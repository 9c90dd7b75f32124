"""Write pictures to files, in the format of the file name."""

import re
from pathlib import Path

from tca_tools.drawing.graphviz import render
from tca_tools.drawing.page import zoomed_page
from tca_tools.errors import NoPicture
from tca_tools.output import check_free, write_output, writing
from tca_wire.text.missing import missing_package

_MACHINES = (".dot", ".svg", ".png", ".pdf")
_MOST_PIXELS = 40_000_000
_DOTS = 2.0
"""The scale of a PNG relative to the SVG, so that it is sharp when enlarged or printed."""


def convert_svg(svg: str, kind: str) -> bytes:
    """Return the picture *svg* as "png" or "pdf". Raises NoPicture if it can't be converted."""
    try:
        import vl_convert  # noqa: PLC0415 - pictures are an extra
    except ImportError:
        raise NoPicture(
            missing_package(f"a .{kind}", "vl-convert-python", "pictures", "ask for .svg")
        ) from None
    try:
        if kind == "pdf":
            return bytes(vl_convert.svg_to_pdf(svg))
        scale = min(_DOTS, (_MOST_PIXELS / _pixels(svg)) ** 0.5)
        return bytes(vl_convert.svg_to_png(svg, scale=scale))
    except ValueError as error:
        raise NoPicture(f"the picture can't be made: {' '.join(str(error).split())}") from None


def write_svg(path: Path, svg: str, title: str = "") -> None:
    """Write an SVG picture as .svg, .html, .png or .pdf.

    Args:
        path: The file; its suffix is the format.
        svg: The picture.
        title: The title of an .html page.

    Raises:
        ToolError: The picture can't be converted or written.
    """
    kind = path.suffix[1:]
    if kind == "html":
        write_output(path, zoomed_page(title, svg))
    else:
        write_output(path, svg if kind == "svg" else convert_svg(svg, kind))


def write_graph(path: Path, source: str, title: str = "") -> None:
    """Write dot source as .dot, or its picture as .svg, .html, .png or .pdf.

    Args:
        path: The file; its suffix is the format.
        source: The dot source.
        title: The title of an .html page.

    Raises:
        ToolError: The file can't be written; NoPicture if the picture can't be drawn.
    """
    kind = path.suffix[1:]
    if kind == "dot":
        write_output(path, source)
        return
    with writing(path):  # pygraphviz needs a temporary file
        picture = render(source, "svg" if kind == "html" else kind)
    write_output(path, zoomed_page(title, picture.decode()) if kind == "html" else picture)


def write_machine(path: Path, source: str) -> None:
    """Write the picture of a machine to a new file, in the format of its name.

    Raises:
        ToolError: The file exists, has another suffix, or can't be written.
    """
    if path.suffix not in _MACHINES:
        raise NoPicture(f"a machine can be drawn as {', '.join(_MACHINES)}, not as '{path.name}'")
    check_free(path)
    write_graph(path, source)


def _pixels(svg: str) -> float:
    width, height = re.findall(r' (?:width|height)="([0-9.]+)', svg)[:2]
    return max(float(width) * float(height), 1.0)
