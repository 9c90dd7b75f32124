"""A machine as a picture in a file."""

from collections.abc import Collection
from pathlib import Path

from tca_module import MisuseError
from tca_tools.drawing.chart_dot import chart_dot
from tca_tools.drawing.picture_file import write_machine
from tca_tools.errors import ToolError
from tca_wire.charts import MachineChart


def draw(chart: MachineChart, path: Path, active: Collection[int]) -> None:
    """Write the kind of picture that the file's name asks for. Raises MisuseError if that can't be done."""
    try:
        write_machine(path, chart_dot(chart, active))
    except ToolError as error:
        raise MisuseError(error.message) from None
