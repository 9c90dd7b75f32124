"""Modules that may be asked directly, and what central was told of it."""

from collections.abc import Callable

from module.real_central import RealCentral, until

from tca_module import Command, Inform, Module, Query
from tca_wire.journal.facts import Delivered, HandledDirectly, LostDirectly

HEIGHT = Query("height", float, reply=float)
DEPTH = Query("depth", float, reply=float)
POSE = Inform("pose", float)
HEARD = Inform("heard", float)
WALK = Command("walk", float, result=float)


def a_map(central: RealCentral | str, name: str = "map", height: Callable[[float], float] = abs) -> Module:
    module = Module(name, central if isinstance(central, str) else central.address)
    module.handles(HEIGHT, direct=True)(lambda _, x: height(x))
    return module


def direct(central: RealCentral, message: str = "height", module: str = "") -> int:
    """How many messages were handled directly (by a module), as far as central has been told."""
    noted = central.facts(HandledDirectly)
    return sum(fact.message == message and module in ("", fact.module) for fact in noted)


def through_central(central: RealCentral) -> int:
    return len(central.facts(Delivered))


def said_lost(central: RealCentral) -> int:
    return sum(fact.number for fact in central.facts(LostDirectly))


def ask_until_direct(
    central: RealCentral, ask: Callable[[], object], message: str = "height", module: str = ""
) -> None:
    """Ask until the question goes directly (to a module)."""
    before = direct(central, message, module)
    until(lambda: (ask(), direct(central, message, module) > before)[1], f"'{message}' goes directly")
