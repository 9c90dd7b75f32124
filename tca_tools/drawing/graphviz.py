"""A picture that Graphviz lays out. Knows nothing of what it shows."""

import shutil
import subprocess
from typing import Any

from tca_tools.errors import NoPicture
from tca_wire.text.missing import missing_package


def drawn(source: str, kind: str) -> bytes:
    """Dot source as "svg", "png" or "pdf", by this machine's Graphviz or a package's. Raises
    NoPicture.
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
