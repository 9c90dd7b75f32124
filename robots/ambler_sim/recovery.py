"""What layers are made of: the exception handlers of the error recovery module, by the names under
which they attach them. The modules that walk have never heard of them.
"""

from robots.ambler_sim.vocabulary import Contact
from tca_module import ExceptionHandler, Failure, Module, Query

RAISE_LEG = ExceptionHandler("raise leg", Contact)
REPLAN_MOVE = ExceptionHandler("replan move", Contact)
PLAN_OTHERWISE = ExceptionHandler("plan otherwise")
SHUFFLE_FEET = ExceptionHandler("shuffle feet")
DO_AGAIN = ExceptionHandler("do again")
GIVE_UP = ExceptionHandler("give up")

STUCK = Failure("stuck", str)
WALK_GIVEN_UP = Failure("walk given up", str)


def make_layer(name: str) -> Module:
    """The module of a layer; it answers the question whether it is attached."""
    module = Module(f"{name} layer")
    module.handles(is_attached(name))(lambda _: True)
    return module


def is_attached(name: str) -> Query[None, bool]:
    """Asks a layer whether it has attached itself: a module does so before it gets any message."""
    return Query(f"{name} attached?", reply=bool)
