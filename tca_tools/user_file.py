"""Run a Python file of the user, such as a scenario or properties, as ``python FILE`` does.

The file can import the modules in its folder.
"""

import runpy
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from tca_tools.errors import BadUserFile

_imported_before: dict[str, set[str]] = {}
"""By the folder of the last file: the modules that had been imported before it ran."""


def names_of(path: Path) -> dict[str, Any]:
    """Run a file. Return the names at its top level. Raises BadUserFile.

    Its folder stays the first place to import from until a file of another folder is run.
    """
    _import_from_folder(path)
    try:
        return runpy.run_path(str(path), run_name=path.stem)
    except (Exception, SystemExit) as error:  # any error is a fault of the file
        where = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if frame.filename == str(path)
        ]
        line = f", line {where[-1]}" if where else ""
        raise BadUserFile(f"{path}{line}: can't be run: {type(error).__name__}: {error}") from error


def _import_from_folder(path: Path) -> None:
    """Import from the folder of a file, and forget the modules of an earlier file's folder."""
    folder = str(path.resolve().parent)
    if folder in _imported_before:
        return
    for other, before in _imported_before.items():
        if other in sys.path:
            sys.path.remove(other)
        for name in sys.modules.keys() - before:
            if any(Path(place).is_relative_to(other) for place in _places(sys.modules[name])):
                del sys.modules[name]
    _imported_before.clear()
    _imported_before[folder] = set(sys.modules)
    sys.path.insert(0, folder)


def _places(module: ModuleType) -> list[str]:
    """Return the places of a module: its file, or the folders of a package without a file."""
    file = getattr(module, "__file__", None)
    return [file] if file else [*getattr(module, "__path__", ())]
