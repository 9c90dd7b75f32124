"""A machine as a picture in a file."""

from collections.abc import Collection
from pathlib import Path

from tca_module import MisuseError
from tca_tools.drawing.chart_dot import chart_dot
from tca_tools.drawing.graphviz import drawn
from tca_tools.errors import ToolError
from tca_tools.output import check_free, write_output
from tca_wire.charts import MachineChart

_KINDS = (".dot", ".svg", ".png", ".pdf")


def draw(chart: MachineChart, path: Path, active: Collection[int]) -> None:
    """Write the kind of picture that the file's name asks for. Raises MisuseError if that can't be done."""
    if path.suffix not in _KINDS:
        raise MisuseError(f"a machine can be drawn as {', '.join(_KINDS)}, not as '{path.name}'")
    source = chart_dot(chart, active)
    try:
        check_free(path)
        write_output(path, source if path.suffix == ".dot" else drawn(source, path.suffix[1:]))
    except ToolError as error:
        raise MisuseError(error.message) from None
