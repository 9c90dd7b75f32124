"""The activity, as processors see it."""

from typing import Protocol


class StateActivity(Protocol):
    """Something short that is to be done once a period."""

    name: str
    """Unique in an application: "x.movement.moving", "x.movement.machine", "x.port handler"."""
    component: str
    period: float
    """Seconds. The component's own wish; a processor may be told another."""
    estimate: float | None
    """Its longest execution time in seconds, as declared; None: it is to be measured."""

    def tick(self) -> None:
        """Do one step. Never blocks. The activity of a state does nothing while that state is not active."""
