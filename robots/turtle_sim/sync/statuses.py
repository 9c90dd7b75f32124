"""The statuses of several robots as one robot knows them, and the protocol that spreads them. Pure:
no socket, no clock.

Each robot sets its own status, with a version that only grows. A datagram holds all statuses that
its sender knows. The receiver stores those with a newer version. A datagram may therefore be lost,
doubled or late: the next datagram makes up for it.

Two things follow. First, a partner's datagram acknowledges the statuses in it. A robot repeats its
datagram only to partners that have not acknowledged all statuses in it. Second, a status never
overtakes its cause. If turtle 2 sets its status because of the status of turtle 1, then every robot
that knows the new status of turtle 2 also knows the status of turtle 1.
"""

from collections.abc import Iterable
from typing import Annotated

import msgspec

from robots.turtle_sim.errors import DamagedDatagram, NoSuchPartner

LARGEST = 8_192
"""The greatest number of bytes in a datagram; longer ones are ignored."""

Version = Annotated[int, msgspec.Meta(ge=1, le=2**53)]


class VersionedStatus(
    msgspec.Struct, frozen=True, array_like=True, order=True, forbid_unknown_fields=True
):
    """A robot's status, and its version."""

    version: Version
    status: int


class Datagram(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """All statuses that a robot knows, and whether the receiver must answer with its own
    datagram.
    """

    sender: str
    known: dict[str, VersionedStatus]
    wants_answer: bool


class Statuses:
    """One robot's table of statuses."""

    def __init__(self, name: str, partners: Iterable[str], status: int = 0) -> None:
        self.name = name
        self.partners = tuple(partners)
        self.known = {name: VersionedStatus(1, status)}
        self._acknowledged: dict[str, dict[str, VersionedStatus]] = {
            partner: {} for partner in self.partners
        }
        self._other_names: dict[str, str] = {}

    # --- for missions -----------------------------------------------------------------------------

    def set(self, status: int) -> None:
        """Change the robot's own status."""
        self.known[self.name] = VersionedStatus(self.known[self.name].version + 1, status)

    def status(self, partner: str) -> int | None:
        """Return the newest known status of a partner; None before the first one. Raises
        NoSuchPartner.
        """
        if partner not in self._acknowledged:
            known = ", ".join(self.partners) or "none"
            raise NoSuchPartner(
                f"'{self.name}' has no partner '{partner}': its partners are {known}"
            )
        return self.known[partner].status if partner in self.known else None

    def words(self, partner: str) -> str:
        """Describe a partner's status as text. Raises NoSuchPartner."""
        if (status := self.status(partner)) is not None:
            return f"the status of '{partner}' is {status}"
        if partner in self._other_names:
            other = self._other_names[partner]
            return f"the robot at the address of '{partner}' calls itself '{other}': rename one"
        return f"'{partner}' has sent nothing: does it run, and is its address right?"

    def waiting_for(self) -> list[str]:
        """Return the partners that have not acknowledged all that is known here."""
        return [
            partner
            for partner, theirs in self._acknowledged.items()
            if not _covers(theirs, self.known)
        ]

    # --- for the link -----------------------------------------------------------------------------

    def due(self) -> list[tuple[str, bytes]]:
        """Return the datagrams to send now, first or again, each with its partner."""
        return [(partner, self._datagram(partner)) for partner in self.waiting_for()]

    def receive(self, partner: str, raw: bytes) -> bytes | None:
        """Process a partner's datagram. Returns the answer, if any. Raises DamagedDatagram."""
        try:
            datagram = _DECODER.decode(raw)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise DamagedDatagram(f"a datagram of '{partner}' is damaged: {error}") from None
        self._acknowledged[partner] = datagram.known
        for robot, received in datagram.known.items():
            self._merge(robot, received)
        if datagram.sender != partner:
            self._other_names[partner] = datagram.sender
        return self._datagram(partner) if datagram.wants_answer else None

    def _merge(self, robot: str, received: VersionedStatus) -> None:
        mine = self.known.get(robot)
        if mine is not None and received <= mine:
            return
        if robot == self.name and mine is not None:
            # This robot was restarted. Its versions continue above the old ones.
            received = VersionedStatus(received.version + 1, mine.status)
        self.known[robot] = received

    def _datagram(self, partner: str) -> bytes:
        wants_answer = not _covers(self._acknowledged[partner], self.known)
        return _ENCODER.encode(Datagram(self.name, self.known, wants_answer))


def _covers(theirs: dict[str, VersionedStatus], mine: dict[str, VersionedStatus]) -> bool:
    """Return whether *theirs* has each status of *mine*, or a newer one."""
    return all(robot in theirs and theirs[robot] >= entry for robot, entry in mine.items())


_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Datagram)
