"""What a page may do to a task of a live run: the same as ``tca kill`` and its like, after the same questions."""

from typing import Annotated

import msgspec

from tca_tools.live.steering import steer
from tca_tools.view.guards import PageKey


class SteeringRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks for."""

    run: str
    """The address of the run that it shows."""
    task: int
    what: str
    why: Annotated[str, msgspec.Meta(max_length=1000)] = ""


class Steering:
    """The way from pages to one central."""

    def __init__(self, central: str | None) -> None:
        self._central = central
        """Its address (None: as all commands find it)."""
        self.key = PageKey("tca view")

    def steer(self, asked: SteeringRequest, epoch: str) -> str:
        """Do it, to a task of the run of that epoch; what became of it. Raises ClickException."""
        return steer(self._central, epoch, asked.what, asked.task, asked.why)
