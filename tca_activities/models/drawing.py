"""A model as a picture in a file."""

from pathlib import Path

from tca_activities.models.dot import model_dot
from tca_activities.models.model import ApplicationModel
from tca_tools.drawing.graphviz import drawn
from tca_tools.output import check_free, write_output

KINDS = (".svg", ".png", ".pdf", ".dot")


def draw(model: ApplicationModel, path: Path) -> None:
    """Write the kind of picture that the file's name asks for. Raises ToolError if that can't be done."""
    source = model_dot(model)
    check_free(path)
    write_output(path, source if path.suffix == ".dot" else drawn(source, path.suffix[1:]))
