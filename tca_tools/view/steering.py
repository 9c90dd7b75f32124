"""What a page may do to a task of a live run: the same as ``tca kill`` and its like, after the same questions.

Only a page opened with the address that the command printed may: its key is known to nobody else. So neither a page of
another site, nor another user of this machine, who may read the run, can steer it.
"""

from hmac import compare_digest
from secrets import token_urlsafe
from typing import Annotated
from urllib.parse import urlsplit

import click
import msgspec

from tca_live.steering import steer
from tca_tools.errors import ToolError


class SteeringRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks for."""

    run: str
    """The address of the run that it shows."""
    task: int
    what: str
    why: Annotated[str, msgspec.Meta(max_length=1000)] = ""


class NotAllowed(ToolError):
    """The page may not steer."""


class Steering:
    """The way from pages to one central."""

    def __init__(self, central: str | None) -> None:
        self._central = central
        """Its address (None: as all commands find it)."""
        self.key = token_urlsafe(16)

    def check(self, key: str, origin: str, host: str) -> None:
        """Raise NotAllowed unless this comes from a page of this server that has the key."""
        if origin and urlsplit(origin).netloc != host:
            raise NotAllowed(f"a page of {origin} may not steer this run")
        if not compare_digest(key.encode(), self.key.encode()):
            raise NotAllowed("this page may only look: to steer, open the address that 'tca view' printed")

    def steer(self, asked: SteeringRequest, epoch: str) -> str:
        """Do it, to a task of the run of that epoch; what became of it. Raises ToolError if it can't be done."""
        try:
            return steer(self._central, epoch, asked.what, asked.task, asked.why)
        except click.ClickException as error:
            raise ToolError(error.message) from None
