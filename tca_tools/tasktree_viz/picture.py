"""Dot source to a picture file, by whichever Graphviz this machine has."""

import subprocess
from typing import Any

from tca_tools.errors import NoPicture


def drawn(source: str, kind: str) -> bytes:
    """The picture that *source* describes, as "svg", "png" or "pdf". Raises NoPicture."""
    missing = []
    for way in (_with_graphviz, _with_pygraphviz):
        try:
            return way(source, kind)
        except _Missing as error:
            missing.append(str(error))
    raise NoPicture(f"no picture can be drawn: {', and '.join(missing)}")


class _Missing(Exception):
    """What one way of drawing lacks."""


def _with_graphviz(source: str, kind: str) -> bytes:
    try:
        import graphviz  # noqa: PLC0415 - pictures are an extra
    except ImportError:
        raise _Missing("the Python package 'graphviz' is missing (pip install 'tca-central[pictures]')") from None
    try:
        picture: bytes = graphviz.Source(source).pipe(format=kind, quiet=True)
    except graphviz.ExecutableNotFound:
        raise _Missing("the program 'dot' is missing (install Graphviz)") from None
    except subprocess.CalledProcessError as error:
        raise NoPicture(f"dot failed: {' '.join((error.stderr or b'').decode(errors='replace').split())}") from None
    return picture


def _with_pygraphviz(source: str, kind: str) -> bytes:
    try:
        import pygraphviz  # noqa: PLC0415
    except ImportError:
        raise _Missing("so is the package 'pygraphviz'") from None
    graph: Any = pygraphviz.AGraph(string=source)
    try:
        picture: bytes = graph.draw(format=kind, prog="dot")
    except (OSError, ValueError) as error:
        raise NoPicture(f"pygraphviz failed: {error}") from None
    return picture
