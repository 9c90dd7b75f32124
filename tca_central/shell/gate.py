"""The gate of central's socket: says of each packet who sent it, and turns strangers away.

Over a Unix socket the kernel reports the user of the other end; over TCP the handshake proves a
key, unless central was told to trust everybody on this computer. Each packet is asked, and not its
line once: a line's routing id can be that of an earlier one. So a key that is gone has no say from
the next look on.
"""

import contextlib
import logging
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import zmq

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import ConnectionLost, Input, KeysChanged, PermissionsChanged
from tca_central.shell.allowed_keys import AllowedKeys, own_pair
from tca_central.shell.authenticator import Authenticator, KeyPair, guard
from tca_central.shell.log_limit import LogLimit
from tca_central.shell.permissions_file import PermissionsFile, users_in
from tca_wire.keys import keys_folder

log = logging.getLogger("tca.central")

_REMEMBERED = 10_000  # peers
# elsewhere ZeroMQ may not say: the folder of the socket must be private
_KNOWS_USERS = sys.platform == "linux"


class Gate:
    """Lets in this user, over a Unix socket, and whom it is told of."""

    why = "central lets in no programs of other users"  #: for those who are turned away

    def __init__(
        self, permissions: PermissionsFile | None = None, socket_file: Path | None = None
    ) -> None:
        self._permissions = permissions
        self._socket_file = socket_file
        self._users = {os.getuid(): ""}
        self._listed: list[int] = []
        self._principals: dict[str, str | None] = {}  #: by what the kernel says of the far end
        self._warned = LogLimit(log)
        self.has_news = False  #: ``news`` has something to tell
        self._told: set[bytes] = set()  #: lines that were turned away, and know it

    def open(
        self, _context: "zmq.Context[zmq.Socket[bytes]]", _socket: "zmq.Socket[bytes]", /
    ) -> None:
        """Guard a socket that is not bound yet."""

    def close(self) -> None:
        """Let nobody in any more."""

    def news(self, now: float, central: Central) -> Iterator[Input]:
        """The events of what has changed in files since the last look, and of whom that cuts
        off.
        """
        permissions = self._permissions
        if permissions is not None:
            permissions.look_again()
        rules = permissions.rules if permissions is not None else None
        if self._socket_file is not None and (users := users_in(rules or ())) != self._listed:
            self._allow_users(users)
        if rules != central.registry.permissions.rules:
            yield PermissionsChanged(
                now, rules, str(permissions.path.absolute()) if permissions is not None else ""
            )

    def _allow_users(self, users: list[int]) -> None:
        """Let these users in, and no others but the one who runs central."""
        assert self._socket_file is not None
        self._listed = users
        self._users = {user: f"uid:{user}" for user in users} | {os.getuid(): ""}
        self._principals.clear()
        with contextlib.suppress(OSError):
            # who comes is asked; its folder may be closed to them
            self._socket_file.chmod(0o666 if users else 0o700)

    def is_new(self, line: bytes) -> bool:
        """Whether a line is turned away for the first time, as far as is remembered."""
        if line in self._told:
            return False
        if len(self._told) >= _REMEMBERED:
            self._told.clear()
        self._told.add(line)
        return True

    def principal_of(self, frame: zmq.Frame) -> str | None:
        """Who sent a frame: "" for the user who runs central, None for those who have no say."""
        peer = _said_of(frame, "Peer-Address")
        try:
            return self._principals[peer]
        except KeyError:
            return self._meet(peer)

    def _meet(self, peer: str) -> str | None:
        fields = peer.split(":")
        if len(fields) == 4 and fields[1].isdecimal():
            principal = self._users.get(int(fields[1]))
        else:
            principal = None if _KNOWS_USERS else ""
        if principal is None:
            who = (
                f"of user {fields[1]} (process {fields[3]})"
                if len(fields) == 4
                else "that does not say whose it is"
            )
            self._warned.warning(peer, "turned away a program %s", who)
        if len(self._principals) >= _REMEMBERED:
            self._principals.clear()
        self._principals[peer] = principal
        return principal


class OpenGate(Gate):
    """Lets everybody in: over TCP, for those who trust whoever can reach it."""

    def principal_of(self, _: zmq.Frame) -> str | None:
        """Everybody counts as the user who runs central."""
        return ""


class KeyGate(Gate):
    """Lets those in who have a key that central allows."""

    why = "central lets in nobody without a key that it allows"

    def __init__(self, folder: Path, permissions: PermissionsFile | None = None) -> None:
        """Keys are in this folder. Raises KeyRefused, or CentralError if there are none."""
        super().__init__(permissions)
        self._own: KeyPair = own_pair(folder)
        self._allowed = AllowedKeys(folder)
        self._authenticator: Authenticator | None = None
        self._was_alive = True
        #: names that have come, and gone, and are not told of
        self._news: tuple[list[str], list[str]] = ([], [])
        self._is_first_look = True
        self._refused: set[str] = set()  #: keys that were allowed, and are no more; or none
        if not self._allowed.names:
            msg = f"no key is allowed in {folder}, so nobody could connect: make one with 'tca keys new NAME'"
            raise CentralError(msg)

    def open(
        self, context: "zmq.Context[zmq.Socket[bytes]]", socket: "zmq.Socket[bytes]", /
    ) -> None:
        """Guard a socket that is not bound yet. Raises CentralError if keys can't be checked
        here.
        """
        self._authenticator = Authenticator(context, self._allowed.is_known)
        self._authenticator.try_out(context, self._own)
        guard(socket, self._own)

    def close(self) -> None:
        """Let nobody in any more."""
        if self._authenticator is not None:
            self._authenticator.close()

    @property
    def is_alive(self) -> bool:
        """Whether newcomers can get in."""
        return self._authenticator is not None and self._authenticator.is_alive

    def news(self, now: float, central: Central) -> Iterator[Input]:
        """The events of what has changed in files since the last look, and of whom that cuts
        off.
        """
        if self._was_alive and not self.is_alive:
            self._was_alive = False
            log.error(
                "nobody can connect any more: the authenticator has ended; start central again"
            )
        self._look()
        (allowed, revoked), self._news, self.has_news = self._news, ([], []), False
        if self._is_first_look:  # keys may have gone while central was away
            self._is_first_look = False
            revoked += sorted(key_owners(central).difference(self._allowed.names.values(), revoked))
        if allowed or revoked:
            yield KeysChanged(now, allowed, revoked)
        for connection in [
            one for one in central.registry.connections.values() if one.principal in revoked
        ]:
            yield ConnectionLost(
                now, connection.id, f"the key '{connection.principal}' is not allowed any more"
            )
        yield from super().news(now, central)

    def _look(self) -> None:
        new, gone = self._allowed.look_again()
        if new or gone:
            self._news[0].extend(new)
            self._news[1].extend(gone)
            self._refused.clear()
            self.has_news = True

    def principal_of(self, frame: zmq.Frame) -> str | None:
        """The name of the key that a frame came with."""
        key = _said_of(frame, "User-Id")
        name = self._allowed.names.get(key)
        if name is None and key not in self._refused:
            self._look()  # it may be so new that only the authenticator knows it
            if (name := self._allowed.names.get(key)) is None:
                self._refused.add(key)
        return name


def key_owners(central: Central) -> set[str]:
    """The keys whose owners central knows: they are, or were, connected."""
    registry = central.registry
    owners = {module.principal for module in registry.modules.values()} | {
        *registry.permissions.licences.values()
    }
    return {owner for owner in owners if owner and not owner.startswith("uid:")}


def _said_of(frame: zmq.Frame, what: str) -> str:
    """What ZeroMQ says of the far end of a frame's line; "" of one that speaks ZeroMQ as it was ten
    years ago.
    """
    try:
        return str(frame.get(what))
    except zmq.ZMQError:
        return ""


def gate_for(endpoint: str, permissions: Path | None = None, *, insecure: bool) -> Gate:
    """The gate for an address; *insecure*: TCP without keys. Raises KeyRefused, CentralError,
    NoHome.
    """
    file = PermissionsFile(permissions) if permissions is not None else None
    if not endpoint.startswith("tcp://"):
        return Gate(file, Path(endpoint.removeprefix("ipc://")))
    return OpenGate(file) if insecure else KeyGate(keys_folder(), file)
