"""The gate of central's socket: finds the sender of each packet, and rejects unknown programs.

Over a Unix socket the kernel reports the user at the other end. Over TCP the handshake proves a
key, unless central trusts every program of this computer (--insecure). The gate checks each packet,
not each connection: a new connection may have the routing id of an earlier one. A revoked key
therefore loses its rights at the next check of the files.
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
# On other systems ZeroMQ may not report the user: there the socket's folder must be private.
_KNOWS_USERS = sys.platform == "linux"


class Gate:
    """Lets in, over a Unix socket, programs of this user and of users whom the permissions name."""

    #: The reason that rejected programs are given.
    rejection = "central lets in no programs of other users"
    #: The public key with which central listens; "" without keys.
    public_key = ""

    def __init__(
        self, permissions: PermissionsFile | None = None, socket_file: Path | None = None
    ) -> None:
        self._permissions = permissions
        self._socket_file = socket_file
        self._users = {os.getuid(): ""}  #: by user id: the principal of each user who may connect
        self._permitted_users: list[int] = []  #: the users that the permissions name
        self._principals: dict[str, str | None] = {}  #: by the kernel's description of the peer
        self._limited_log = LogLimit(log)
        self.has_changes = False  #: whether ``changes`` has events
        self._rejected: set[bytes] = set()  #: connections that know of their rejection

    def open(
        self, _context: "zmq.Context[zmq.Socket[bytes]]", _socket: "zmq.Socket[bytes]", /
    ) -> None:
        """Guard a socket that is not bound yet."""

    def close(self) -> None:
        """Admit no more programs."""

    def changes(self, now: float, central: Central) -> Iterator[Input]:
        """Yield the events for changed files, and for connections that these cut off."""
        permissions = self._permissions
        if permissions is not None:
            permissions.refresh()
        rules = permissions.rules if permissions is not None else None
        users = users_in(rules or ())
        if self._socket_file is not None and users != self._permitted_users:
            self._allow_users(users, self._socket_file)
        if rules != central.registry.permissions.rules:
            yield PermissionsChanged(
                now, rules, str(permissions.path.absolute()) if permissions is not None else ""
            )

    def _allow_users(self, users: list[int], socket_file: Path) -> None:
        """Admit the programs of central's user and of the given users, and no others."""
        self._permitted_users = users
        self._users = {user: f"uid:{user}" for user in users} | {os.getuid(): ""}
        self._principals.clear()
        with contextlib.suppress(OSError):
            # If the permissions name other users, all users may open the socket's file: the gate
            # checks each packet. The folder of the file may still keep them out.
            socket_file.chmod(0o666 if users else 0o700)

    def is_first_rejection(self, connection: bytes) -> bool:
        """Note a connection's rejection. Return False if an earlier rejection is remembered."""
        if connection in self._rejected:
            return False
        if len(self._rejected) >= _REMEMBERED:
            self._rejected.clear()
        self._rejected.add(connection)
        return True

    def principal_of(self, frame: zmq.Frame) -> str | None:
        """Return the sender of a frame: "" for central's user, None for an unknown program."""
        peer = _frame_property(frame, "Peer-Address")
        try:
            return self._principals[peer]
        except KeyError:
            return self._identify(peer)

    def _identify(self, peer: str) -> str | None:
        """Return the principal of a new peer, and remember it."""
        fields = peer.split(":")
        if len(fields) == 4 and fields[1].isdecimal():
            principal = self._users.get(int(fields[1]))
        else:
            principal = None if _KNOWS_USERS else ""
        if principal is None:
            owner = (
                f"of user {fields[1]} (process {fields[3]})"
                if len(fields) == 4
                else "of an unknown user"
            )
            self._limited_log.warning(peer, "rejected a program %s", owner)
        if len(self._principals) >= _REMEMBERED:
            self._principals.clear()
        self._principals[peer] = principal
        return principal


class OpenGate(Gate):
    """Lets in every program: over TCP, where all programs that can reach the socket are trusted."""

    def principal_of(self, _: zmq.Frame) -> str | None:
        """Return "": every program counts as one of central's user."""
        return ""


class KeyGate(Gate):
    """Lets in programs with a key that central allows."""

    rejection = "central lets in only programs with a key that it allows"

    def __init__(self, folder: Path, permissions: PermissionsFile | None = None) -> None:
        """The keys are in *folder*. Raises KeyRefused, or CentralError if no key is allowed."""
        super().__init__(permissions)
        self._own: KeyPair = own_pair(folder)
        self.public_key = self._own.public
        self._allowed = AllowedKeys(folder)
        self._authenticator: Authenticator | None = None
        self._was_alive = True
        #: Names of newly allowed and newly revoked keys. ``changes`` has yet to yield their event.
        self._changed_keys: tuple[list[str], list[str]] = ([], [])
        self._is_first_check = True
        self._refused: set[str] = set()  #: keys known not to be allowed
        if not self._allowed.names:
            msg = (
                f"no key is allowed in {folder}, so no program could connect: "
                "make one with 'tca keys new NAME'"
            )
            raise CentralError(msg)

    def open(
        self, context: "zmq.Context[zmq.Socket[bytes]]", socket: "zmq.Socket[bytes]", /
    ) -> None:
        """Guard a socket that is not bound yet. Raises CentralError if keys can't be checked."""
        self._authenticator = Authenticator(context, self._allowed.is_known)
        self._authenticator.try_out(context, self._own)
        guard(socket, self._own)

    def close(self) -> None:
        """Admit no more programs."""
        if self._authenticator is not None:
            self._authenticator.close()

    @property
    def is_alive(self) -> bool:
        """Whether new connections can get in."""
        return self._authenticator is not None and self._authenticator.is_alive

    def changes(self, now: float, central: Central) -> Iterator[Input]:
        """Yield the events for changed files, and for connections that these cut off."""
        if self._was_alive and not self.is_alive:
            self._was_alive = False
            log.error(
                "no program can connect any more: the authenticator has ended; start central again"
            )
        self._refresh_keys()
        (allowed, revoked), self._changed_keys = self._changed_keys, ([], [])
        self.has_changes = False
        if self._is_first_check:  # keys may have been revoked while central was down
            self._is_first_check = False
            revoked += sorted(key_owners(central).difference(self._allowed.names.values(), revoked))
        if allowed or revoked:
            yield KeysChanged(now, allowed, revoked)
        for connection in [
            one for one in central.registry.connections.values() if one.principal in revoked
        ]:
            yield ConnectionLost(
                now, connection.id, f"the key '{connection.principal}' is not allowed any more"
            )
        yield from super().changes(now, central)

    def _refresh_keys(self) -> None:
        """Note which keys were allowed and revoked since the last call."""
        added, removed = self._allowed.refresh()
        if added or removed:
            self._changed_keys[0].extend(added)
            self._changed_keys[1].extend(removed)
            self._refused.clear()
            self.has_changes = True

    def principal_of(self, frame: zmq.Frame) -> str | None:
        """Return the name of the key that a frame came with; None if it is not allowed."""
        key = _frame_property(frame, "User-Id")
        name = self._allowed.names.get(key)
        if name is None and key not in self._refused:
            self._refresh_keys()  # the authenticator may have let in a newer key
            if (name := self._allowed.names.get(key)) is None:
                self._refused.add(key)
        return name


def key_owners(central: Central) -> set[str]:
    """Return the names of keys whose programs are connected to central."""
    owners = {module.principal for module in central.registry.modules.values()}
    return {owner for owner in owners if owner and not owner.startswith("uid:")}


def _frame_property(frame: zmq.Frame, what: str) -> str:
    """Return a property that ZeroMQ reports of a frame's peer; "" if ZeroMQ reports none."""
    try:
        return str(frame.get(what))
    except zmq.ZMQError:
        return ""


def gate_for(endpoint: str, permissions: Path | None = None, *, insecure: bool) -> Gate:
    """Return the gate for an address.

    Args:
        endpoint: The address that central binds.
        permissions: The permissions file, if there is one.
        insecure: Whether TCP needs no keys.

    Raises:
        KeyRefused: The folder of keys can't be used.
        CentralError: No key is allowed, or the permissions file is wrong.
        NoHome: There is no folder of keys, since the user has no home.
    """
    file = PermissionsFile(permissions) if permissions is not None else None
    if not endpoint.startswith("tcp://"):
        return Gate(file, Path(endpoint.removeprefix("ipc://")))
    return OpenGate(file) if insecure else KeyGate(keys_folder(), file)
