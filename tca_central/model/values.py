"""Small values that connections and deliveries hold."""

from typing import NamedTuple


class Blocking(NamedTuple):
    """A wait of a connection or coroutine, which does nothing until a request is answered."""

    origin: int  #: the delivery whose handler waits (0: none)
    since: int  #: the event in which the wait began
    at: float  #: the time of that event
    #: The numbers of all requests, if the wait is for several. One answer ends the wait.
    together: tuple[int, ...] = ()
    is_coroutine: bool = False


class Refusals(NamedTuple):
    """The refusals of unconfirmed tasks that the handler of a delivery has sent."""

    delivery: int = 0
    number: int = 0
    text: str = ""  #: the text of the last refusal


NOTHING_REFUSED = Refusals()
