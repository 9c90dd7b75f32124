"""Runs a Python file of the user's, a scenario or properties to check, as ``python FILE`` does: it
can import what lies beside it.
"""

import runpy
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from tca_tools.errors import BadUserFile

_beside: dict[str, set[str]] = {}
"""By the folder of the file that was run last: the names that had been imported before."""


def names_of(path: Path) -> dict[str, Any]:
    """Run a file; the names at its top level. Raises BadUserFile.

    Its folder stays the first place to import from until a file in another folder is run.
    """
    _look_beside(path)
    try:
        return runpy.run_path(str(path), run_name=path.stem)
    except (Exception, SystemExit) as error:  # whatever it is, the fault is in the file
        where = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if frame.filename == str(path)
        ]
        line = f", line {where[-1]}" if where else ""
        raise BadUserFile(f"{path}{line}: can't be run: {type(error).__name__}: {error}") from error


def _look_beside(path: Path) -> None:
    """Let a file import what lies in its folder, and nothing that an earlier file had beside it."""
    folder = str(path.resolve().parent)
    if folder in _beside:
        return
    for other, before in _beside.items():
        if other in sys.path:
            sys.path.remove(other)
        for name in sys.modules.keys() - before:
            if any(Path(place).is_relative_to(other) for place in _places(sys.modules[name])):
                del sys.modules[name]
    _beside.clear()
    _beside[folder] = set(sys.modules)
    sys.path.insert(0, folder)


def _places(module: ModuleType) -> list[str]:
    """The place of a module; a folder without ``__init__.py`` has several places and no file."""
    file = getattr(module, "__file__", None)
    return [file] if file else [*getattr(module, "__path__", ())]
