"""Dot source to a picture, by the Graphviz that this machine has: the program, or the one inside a Python package."""

import shutil
import subprocess
from typing import Any

from tca_tools.errors import NoPicture


def drawn(source: str, kind: str) -> bytes:
    """The picture that *source* describes, as "svg", "png" or "pdf". Raises NoPicture."""
    if program := shutil.which("dot"):
        done = subprocess.run([program, f"-T{kind}"], input=source.encode(), capture_output=True, check=False)
        if done.returncode:
            raise NoPicture(f"dot failed: {' '.join(done.stderr.decode(errors='replace').split())}")
        return done.stdout
    try:
        import pygraphviz  # noqa: PLC0415 - pictures are an extra
    except ImportError:
        raise NoPicture("no picture can be drawn: the program 'dot' is missing (install Graphviz)") from None
    graph: Any = pygraphviz.AGraph(string=source)
    try:
        return bytes(graph.draw(format=kind, prog="dot"))
    except (OSError, ValueError) as error:
        raise NoPicture(f"pygraphviz failed: {error}") from None
