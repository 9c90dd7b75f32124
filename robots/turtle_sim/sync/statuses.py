"""What each of several robots knows of the status of all, and how it gets to know that. Pure: no
socket, no clock.

Each robot sets its own status, under a version that only grows. A datagram holds all that its
sender knows, and the receiver takes over what is newer. So a datagram may be lost, doubled or late:
the next one makes up for it.

Two things follow. A robot's own entry in a partner's datagram is the acknowledgement: a robot
repeats its datagram only to partners that don't know yet what it knows. And news never overtake
their causes: if turtle 2 set its status because of turtle 1's, then all who have heard of turtle
2's new status have heard of turtle 1's, too.
"""

from collections.abc import Iterable
from typing import Annotated

import msgspec

from robots.turtle_sim.errors import DamagedDatagram, NoSuchPartner

LARGEST = 8_192
"""Bytes of a datagram; a longer one is not of ours."""

Version = Annotated[int, msgspec.Meta(ge=1, le=2**53)]


class VersionedStatus(
    msgspec.Struct, frozen=True, array_like=True, order=True, forbid_unknown_fields=True
):
    """A robot's status, and its version."""

    version: Version
    status: int


class Datagram(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """All that a robot knows; and whether it wants to be told what the receiver knows then."""

    sender: str
    known: dict[str, VersionedStatus]
    wants_answer: bool


class Statuses:
    """One robot's table."""

    def __init__(self, name: str, partners: Iterable[str], status: int = 0) -> None:
        self.name = name
        self.partners = tuple(partners)
        self.known = {name: VersionedStatus(1, status)}
        self._told: dict[str, dict[str, VersionedStatus]] = {
            partner: {} for partner in self.partners
        }
        self._other_names: dict[str, str] = {}

    # --- what missions ask ------------------------------------------------------------------------

    def set(self, status: int) -> None:
        """Change one's own status."""
        self.known[self.name] = VersionedStatus(self.known[self.name].version + 1, status)

    def status(self, partner: str) -> int | None:
        """The newest that is known of a partner; None before anything was heard. Raises
        NoSuchPartner.
        """
        if partner not in self._told:
            known = ", ".join(self.partners) or "none"
            raise NoSuchPartner(
                f"'{self.name}' has no partner '{partner}': its partners are {known}"
            )
        return self.known[partner].status if partner in self.known else None

    def words(self, partner: str) -> str:
        """What is known of a partner, for people."""
        if (status := self.status(partner)) is not None:
            return f"the status of '{partner}' is {status}"
        if partner in self._other_names:
            return f"the robot at the address of '{partner}' calls itself '{self._other_names[partner]}': rename one"
        return f"nothing was ever heard of '{partner}': does it run, and is its address right?"

    def waiting_for(self) -> list[str]:
        """The partners who have not acknowledged all that is known here."""
        return [
            partner for partner, theirs in self._told.items() if not _covers(theirs, self.known)
        ]

    # --- what the link asks -----------------------------------------------------------------------

    def due(self) -> list[tuple[str, bytes]]:
        """What must be sent (again) now, and to whom."""
        return [(partner, self._datagram(partner)) for partner in self.waiting_for()]

    def receive(self, partner: str, raw: bytes) -> bytes | None:
        """Take a datagram of a partner; the answer that must be sent at once, if any. Raises
        DamagedDatagram.
        """
        try:
            datagram = _DECODER.decode(raw)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise DamagedDatagram(f"a datagram of '{partner}' is damaged: {error}") from None
        self._told[partner] = datagram.known
        for robot, heard in datagram.known.items():
            self._merge(robot, heard)
        if datagram.sender != partner:
            self._other_names[partner] = datagram.sender
        return self._datagram(partner) if datagram.wants_answer else None

    def _merge(self, robot: str, heard: VersionedStatus) -> None:
        mine = self.known.get(robot)
        if mine is not None and heard <= mine:
            return
        if (
            robot == self.name and mine is not None
        ):  # from before this robot was started anew: go on above that
            heard = VersionedStatus(heard.version + 1, mine.status)
        self.known[robot] = heard

    def _datagram(self, partner: str) -> bytes:
        wants_answer = not _covers(self._told[partner], self.known)
        return _ENCODER.encode(Datagram(self.name, self.known, wants_answer))


def _covers(theirs: dict[str, VersionedStatus], mine: dict[str, VersionedStatus]) -> bool:
    return all(robot in theirs and theirs[robot] >= entry for robot, entry in mine.items())


_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Datagram)
