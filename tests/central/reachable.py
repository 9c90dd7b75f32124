"""What central holds: all that can be reached from it."""

import gc
from collections.abc import Iterator
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

from tca_central.core import Central

CODE = (type, ModuleType, FunctionType, BuiltinFunctionType, MethodType)


def reachable(central: Central) -> Iterator[object]:
    """Every object but code, once."""
    seen, frontier = {id(central)}, [central]
    while frontier:
        for one in gc.get_referents(frontier.pop()):
            if not isinstance(one, CODE) and id(one) not in seen:
                seen.add(id(one))
                frontier.append(one)
                yield one
