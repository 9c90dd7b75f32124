"""Pictures as files of the kinds that their names ask for. Knows nothing of what they show."""

import re
from pathlib import Path

from tca_tools.drawing.graphviz import drawn
from tca_tools.drawing.page import zoomed_page
from tca_tools.errors import NoPicture
from tca_tools.output import check_free, made_for, write_output
from tca_wire.text.missing import missing_package

_MACHINES = (".dot", ".svg", ".png", ".pdf")
_MOST_PIXELS = 40_000_000
_DOTS = 2.0
"""Pixels of a PNG for each of the SVG, along an edge: sharp when it is looked at closely or
printed.
"""


def converted(svg: str, kind: str) -> bytes:
    """The picture *svg* as "png" or "pdf". Raises NoPicture if that can't be done here."""
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
    """Write an SVG picture, as a page (.html) with that title, or as .png or .pdf. Raises
    ToolError.
    """
    kind = path.suffix[1:]
    if kind == "html":
        write_output(path, zoomed_page(title, svg))
    else:
        write_output(path, svg if kind == "svg" else converted(svg, kind))


def write_graph(path: Path, source: str, title: str = "") -> None:
    """Write dot source, or the picture of it: as a page (.html) with that title, .svg, .png or
    .pdf. Raises ToolError, NoPicture if that can't be drawn here.
    """
    kind = path.suffix[1:]
    if kind == "dot":
        write_output(path, source)
        return
    with made_for(path):  # without "dot" a library draws into a file of its own
        picture = drawn(source, "svg" if kind == "html" else kind)
    write_output(path, zoomed_page(title, picture.decode()) if kind == "html" else picture)


def write_machine(path: Path, source: str) -> None:
    """Write dot source of a machine as the kind of picture that the file's name asks for, if
    nothing is in the way. Raises ToolError if that can't be done.
    """
    if path.suffix not in _MACHINES:
        raise NoPicture(f"a machine can be drawn as {', '.join(_MACHINES)}, not as '{path.name}'")
    check_free(path)
    write_graph(path, source)


def _pixels(svg: str) -> float:
    width, height = re.findall(r' (?:width|height)="([0-9.]+)', svg)[:2]
    return max(float(width) * float(height), 1.0)
