"""An SVG picture in other formats. Knows nothing of what it shows."""

import re
from pathlib import Path

from tca_tools.errors import NoPicture
from tca_tools.output import write_output
from tca_wire.text.missing import missing_package

_MOST_PIXELS = 40_000_000
_DOTS = 2.0
"""Pixels of a PNG for each of the SVG, along an edge: sharp when it is looked at closely or printed."""


def converted(svg: str, kind: str) -> bytes:
    """The picture *svg* as "png" or "pdf". Raises NoPicture if that can't be done here."""
    try:
        import vl_convert  # noqa: PLC0415 - pictures are an extra
    except ImportError:
        raise NoPicture(missing_package(f"a .{kind}", "vl-convert-python", "pictures", "ask for .svg")) from None
    try:
        if kind == "pdf":
            return bytes(vl_convert.svg_to_pdf(svg))
        scale = min(_DOTS, (_MOST_PIXELS / _pixels(svg)) ** 0.5)
        return bytes(vl_convert.svg_to_png(svg, scale=scale))
    except ValueError as error:
        raise NoPicture(f"the picture can't be made: {' '.join(str(error).split())}") from None


def write_svg(path: Path, svg: str) -> None:
    """Write the picture *svg* as the kind of file that the name asks for. Raises ToolError."""
    kind = path.suffix[1:]
    write_output(path, svg if kind == "svg" else converted(svg, kind))


def _pixels(svg: str) -> float:
    width, height = re.findall(r' (?:width|height)="([0-9.]+)', svg)[:2]
    return max(float(width) * float(height), 1.0)
