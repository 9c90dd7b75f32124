"""The exception handlers of the error recovery module, and a function that makes a layer.

Layers attach these exception handlers. The modules that walk do not know them.
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
    """Make the module of a layer, with a handler for the query whether the layer is attached."""
    module = Module(f"{name} layer")
    module.handles(is_attached(name))(lambda _: True)
    return module


def is_attached(name: str) -> Query[None, bool]:
    """Return the query whether a layer is attached. A layer's module attaches the layer before its
    first message.
    """
    return Query(f"{name} attached?", reply=bool)
