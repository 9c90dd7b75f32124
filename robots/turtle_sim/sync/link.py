"""A robot's link to its partners: UDP datagrams that are repeated until they are acknowledged."""

import random
import socket
import threading
import time
from typing import Self

from robots.turtle_sim.errors import BadTeam, DamagedDatagram
from robots.turtle_sim.sync.statuses import LARGEST, Statuses
from robots.turtle_sim.sync.team import Team, load_team

REPEAT = 0.05
"""Seconds after which an unacknowledged datagram is sent again."""


class StatusLink:
    """Sends the status of this robot to its partners, and stores the partners' statuses. The link
    has a thread, and may be used from any thread.

    It trusts every datagram from a partner's address. On an open network, connect the partners
    through a tunnel.
    """

    def __init__(self, name: str, team: Team, *, loss: float = 0.0) -> None:
        """Create the link of the robot *name*. The other robots of the *team* are its partners.

        For trials, the link drops the share *loss* of the datagrams that it sends. Raises BadTeam.
        """
        if name not in team:
            raise BadTeam(
                f"'{name}' is not in the team: its members are {', '.join(team) or 'none'}"
            )
        self._own_address = team[name]
        self._addresses = {partner: address for partner, address in team.items() if partner != name}
        self._statuses = Statuses(name, self._addresses)
        self._loss, self._random = loss, random.Random(name)  # noqa: S311 - a simulated loss
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._serve, name=f"link of {name}", daemon=True)
        self._is_closed = False
        self.sent = self.lost = 0  #: datagrams

    @classmethod
    def from_file(cls, name: str, team: str, *, loss: float = 0.0) -> Self:
        """Create the link of the robot *name* with the team of a file. Raises BadTeam."""
        return cls(name, load_team(team), loss=loss)

    def __enter__(self) -> Self:
        """Start to listen. Raises BadTeam if the address is not available."""
        try:
            self._socket.bind(self._own_address)
        except OSError as error:
            self._socket.close()
            host, port = self._own_address
            raise BadTeam(
                f"'{self._statuses.name}' can't listen at {host}:{port}: {error}"
            ) from None
        self._socket.settimeout(REPEAT)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop sending and listening."""
        self._is_closed = True
        self._thread.join()
        self._socket.close()

    # --- statuses ---------------------------------------------------------------------------------

    def set_status(self, status: int) -> None:
        """Change the status of this robot, and send it to the partners."""
        with self._lock:
            self._statuses.set(status)
            self._send_due()

    def status(self, partner: str) -> int | None:
        """Return the newest known status of a partner; None before the first one. Raises
        NoSuchPartner.
        """
        with self._lock:
            return self._statuses.status(partner)

    def words(self, partner: str) -> str:
        """Describe a partner's status as text. Raises NoSuchPartner."""
        with self._lock:
            return self._statuses.words(partner)

    # --- datagrams --------------------------------------------------------------------------------

    def _serve(self) -> None:
        partners = {address: partner for partner, address in self._addresses.items()}
        repeat_at = 0.0
        while not self._is_closed:
            if time.monotonic() >= repeat_at:
                repeat_at = time.monotonic() + REPEAT
                with self._lock:
                    self._send_due()
            try:
                raw, address = self._socket.recvfrom(LARGEST + 1)
            except TimeoutError:
                continue
            if address in partners and len(raw) <= LARGEST:
                self._receive(partners[address], raw)

    def _receive(self, partner: str, raw: bytes) -> None:
        with self._lock:
            try:
                answer = self._statuses.receive(partner, raw)
            except DamagedDatagram:
                return  # as if it had been lost
            if answer is not None:
                self._send(partner, answer)

    def _send_due(self) -> None:
        for partner, datagram in self._statuses.due():
            self._send(partner, datagram)

    def _send(self, partner: str, datagram: bytes) -> None:
        self.sent += 1
        if self._random.random() < self._loss:
            self.lost += 1
            return
        try:
            self._socket.sendto(datagram, self._addresses[partner])
        except OSError:
            self.lost += 1  # the partner can't be reached now: the datagram is repeated
