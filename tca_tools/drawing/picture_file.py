"""A picture of a machine in a file."""

from pathlib import Path

from tca_tools.drawing.graphviz import drawn
from tca_tools.errors import NoPicture
from tca_tools.output import check_free, write_output

_KINDS = (".dot", ".svg", ".png", ".pdf")


def write_machine(path: Path, source: str) -> None:
    """Write dot source as the kind of picture that the file's name asks for. Raises ToolError if that can't be done."""
    if path.suffix not in _KINDS:
        raise NoPicture(f"a machine can be drawn as {', '.join(_KINDS)}, not as '{path.name}'")
    check_free(path)
    write_output(path, source if path.suffix == ".dot" else drawn(source, path.suffix[1:]))
