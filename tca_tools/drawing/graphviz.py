"""Draw pictures with Graphviz."""

import shutil
import subprocess
from typing import Any

from tca_tools.errors import NoPicture
from tca_wire.text.missing import missing_package


def render(source: str, kind: str) -> bytes:
    """Draw a picture of dot source, with the installed Graphviz or else with pygraphviz.

    Args:
        source: The dot source.
        kind: "svg", "png" or "pdf".

    Raises:
        NoPicture: Neither is installed, or drawing failed.
    """
    if program := shutil.which("dot"):
        done = subprocess.run(
            [program, f"-T{kind}"], input=source.encode(), capture_output=True, check=False
        )
        if done.returncode:
            raise NoPicture(f"dot failed: {' '.join(done.stderr.decode(errors='replace').split())}")
        return done.stdout
    try:
        import pygraphviz  # noqa: PLC0415 - pictures are an extra
    except ImportError:
        raise NoPicture(
            missing_package("this picture", "pygraphviz", "pictures", "install Graphviz")
        ) from None
    graph: Any = pygraphviz.AGraph(string=source)
    try:
        return bytes(graph.draw(format=kind, prog="dot"))
    except (OSError, ValueError) as error:
        raise NoPicture(f"pygraphviz failed: {error}") from None
