"""A machine as a picture in a file."""

from pathlib import Path

from tca_module import MisuseError
from tca_tools.drawing.coordination_dot import coordination_dot
from tca_tools.drawing.picture_file import write_machine
from tca_tools.errors import ToolError
from tca_wire.coordination import CoordinationChart, CoordinationReport


def draw(chart: CoordinationChart, path: Path, report: CoordinationReport | None) -> None:
    """Write the kind of picture that the file's name asks for. Raises MisuseError if that can't be done."""
    try:
        write_machine(path, coordination_dot(chart, report))
    except ToolError as error:
        raise MisuseError(error.message) from None
