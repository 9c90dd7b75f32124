"""Key files: the proof of a program's identity, and the one central that it trusts.

A client's file holds its own pair of CURVE keys and the public key of its central. A secret file
that other users may read is refused.
"""

import os
import re
import stat
import tomllib
from pathlib import Path
from typing import NamedTuple

from tca_wire.endpoint import home
from tca_wire.errors import KeyRefused

VARIABLE = "TCA_KEY"
DEFAULT = "default"
"""The key of programs that name none."""
NO_KEY = "none"
OWNER = "owner"
"""The word for central's user in permissions. With --insecure every program counts as that user."""
SUFFIX = ".key"
FOLDER_VARIABLE = "TCA_KEYS"

_LENGTH = 40
"""Characters of a key, in ZeroMQ's Z85."""
_RESERVED = {"central", NO_KEY, OWNER}
_Z85 = re.compile(r"[0-9a-zA-Z.\-:+=^!/*?&<>()\[\]{}@%$#]{40}")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


class ClientKey(NamedTuple):
    """A program's own key, and that of its central."""

    name: str
    public: str
    secret: str
    central: str
    """Central's public key: the program talks to no other central."""


def keys_folder() -> Path:
    """Return the folder of keys: ``$TCA_KEYS``, or ``tca/keys`` in ``$XDG_CONFIG_HOME`` or
    ``~/.config``.

    It may not exist.
    """
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    config = os.environ.get("XDG_CONFIG_HOME") or home(FOLDER_VARIABLE) / ".config"
    return Path(config) / "tca" / "keys"


def check_name(name: str) -> None:
    """Raise KeyRefused if a key can't have this name."""
    if not _NAME.fullmatch(name) or name.endswith((SUFFIX, ".pub")):
        msg = f"'{name}' can't be the name of a key: use up to 64 letters, digits, '_', '-' and '.'"
        raise KeyRefused(msg)
    if name in _RESERVED:
        msg = f"'{name}' can't be the name of a key: it is reserved; choose another"
        raise KeyRefused(msg)


def check_key(text: str) -> None:
    """Raise KeyRefused if a text is not a CURVE key."""
    if not _is_key(text):
        raise KeyRefused(
            f"{text[:60]!r} is not a public key of {_LENGTH} characters: 'tca keys list' shows them"
        )


def _is_key(text: object) -> bool:
    return isinstance(text, str) and _Z85.fullmatch(text) is not None


def read_secret(path: Path, *names: str) -> dict[str, str]:
    """Return the texts of a secret file by their names. Raises KeyRefused if a key is missing.

    *names* are the keys that the file must have.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            found = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise KeyRefused(f"can't read the key {path}: {why}") from None
    if stat.S_IMODE(mode) & 0o077:
        msg = f"others may read the key {path}: chmod 600 it, or replace it if they have read it"
        raise KeyRefused(msg)
    for name in names:
        if not _is_key(found.get(name)):
            raise KeyRefused(
                f"{path} is not a key: it has no '{name}' of {_LENGTH} characters;"
                " make one with 'tca keys new'"
            )
    return {name: text for name, text in found.items() if isinstance(text, str)}


def read_client_key(path: Path) -> ClientKey:
    """Read the key in a client's file. Raises KeyRefused."""
    found = read_secret(path, "public", "secret", "central")
    return ClientKey(
        found.get("name", path.stem), found["public"], found["secret"], found["central"]
    )


def client_key(address: str) -> ClientKey | None:
    """Return the key to show the central at an address. Raises KeyRefused.

    ``$TCA_KEY`` names the key: a file, a name in the folder of keys, or 'none'. Without the
    variable the key is 'default', if it exists. Over Unix sockets the result is None: the kernel
    identifies the client.
    """
    if not address.startswith("tcp://"):
        return None
    if (named := os.environ.get(VARIABLE)) == NO_KEY:
        return None
    if not named:
        path = keys_folder() / f"{DEFAULT}{SUFFIX}"
        return read_client_key(path) if path.exists() else None
    if "/" in named:
        return read_client_key(Path(named))
    return read_client_key(keys_folder() / f"{named.removesuffix(SUFFIX)}{SUFFIX}")
