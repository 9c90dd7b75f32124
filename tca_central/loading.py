"""Tells whether the installed core is compiled (setup.py), and gives the compiler information."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING

__all__ = ["is_compiled", "mypyc_attr"]

if TYPE_CHECKING:
    from mypy_extensions import mypyc_attr
else:

    def mypyc_attr(**_: bool) -> Callable[[type], type]:
        """Return a decorator that changes nothing. The compiler reads its arguments."""
        return lambda kind: kind


def is_compiled() -> bool:
    """Whether the installed core is machine code."""
    spec = find_spec("tca_central.core")
    return spec is not None and not str(spec.origin).endswith(".py")
