"""Which core is loaded: an installation may have machine code, too (setup.py), and TCA_PURE=1 takes the Python."""

import os
import sys
from collections.abc import Callable
from importlib.machinery import SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

__all__ = ["is_compiled", "mypyc_attr"]

if TYPE_CHECKING:
    from mypy_extensions import mypyc_attr
else:

    def mypyc_attr(**_: bool) -> Callable[[type], type]:
        """Tell the compiler more about a class: here it means nothing."""
        return lambda kind: kind


if os.environ.get("TCA_PURE"):
    for room in Path(__file__).parent.glob("**/__init__.py"):
        sys.path_importer_cache[str(room.parent)] = FileFinder(str(room.parent), (SourceFileLoader, SOURCE_SUFFIXES))


def is_compiled() -> bool:
    """Whether the core that is loaded, or would be, is machine code."""
    spec = find_spec("tca_central.core")
    return spec is not None and spec.origin is not None and Path(spec.origin).suffix != ".py"
