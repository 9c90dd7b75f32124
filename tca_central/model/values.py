"""Small values that connections and deliveries hold."""

from typing import NamedTuple


class Blocking(NamedTuple):
    """A wait: a connection or a coroutine does nothing until its request is answered."""

    origin: int  #: the delivery whose handler waits (0: none)
    since: int  #: the event in which the wait began
    at: float  #: the time of that event
    #: A wait for several requests: all of them; one answer is enough.
    together: tuple[int, ...] = ()
    is_coroutine: bool = False


class Refusals(NamedTuple):
    """The refusals of unconfirmed tasks that the handler of a delivery has sent."""

    delivery: int = 0
    number: int = 0
    text: str = ""  #: of the last refusal


NOTHING_REFUSED = Refusals()
