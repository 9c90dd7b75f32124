"""The folder of keys, as central and ``tca keys`` use it.

``central.key`` is central's secret; ``allowed/NAME.pub`` holds the public key of the program NAME;
``NAME.key`` is the file for that program. Only the owner may enter the folder, and no file is
overwritten.
"""

import logging
import os
import stat
from pathlib import Path

from tca_central.shell.authenticator import KeyPair, new_pair
from tca_wire.errors import KeyRefused
from tca_wire.keys import SUFFIX, check_key, check_name, read_secret

log = logging.getLogger("tca.central")

CENTRAL = f"central{SUFFIX}"
PUBLIC = ".pub"


def allowed_folder(folder: Path) -> Path:
    """Return the folder with the public keys of programs that may connect."""
    return folder / "allowed"


def make_folder(folder: Path) -> None:
    """Create the folders of keys, readable by their owner only. Raises KeyRefused."""
    for path in (folder, allowed_folder(folder)):
        try:
            path.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise KeyRefused(f"can't make {path}: {error.strerror}") from None
        check_folder(path)


def check_folder(folder: Path) -> None:
    """Raise KeyRefused if other users may enter the folder."""
    status = folder.stat()
    if status.st_uid not in (os.getuid(), 0) or stat.S_IMODE(status.st_mode) & 0o077:
        raise KeyRefused(f"others may enter {folder}, the folder of keys: chmod 700 it")


def write_new(
    path: Path, text: str, advice: str = "choose another name, or revoke that key first"
) -> None:
    """Create a file, readable by its owner only. Raises KeyRefused, also if the file exists."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    except FileExistsError:
        raise KeyRefused(f"{path} exists already: {advice}") from None
    except OSError as error:
        raise KeyRefused(f"can't write {path}: {error.strerror}") from None
    with os.fdopen(file, "w") as opened:
        opened.write(text)
        opened.flush()
        os.fsync(file)


def own_pair(folder: Path) -> KeyPair:
    """Return central's own keys, generated at the first call. Raises KeyRefused."""
    make_folder(folder)
    path = folder / CENTRAL
    if not path.exists():
        pair = new_pair()
        text = "# Central's own key. Secret: a program that has it can pass for central.\n"
        write_new(path, f'{text}public = "{pair.public}"\nsecret = "{pair.secret}"\n')
    fields = read_secret(path, "public", "secret")
    return KeyPair(fields["public"], fields["secret"])


def names_allowed(folder: Path) -> dict[str, str]:
    """Return the names of programs that may connect, by public key. Warn of invalid key files.

    If two files have the same key, the first name counts.
    """
    names: dict[str, str] = {}
    for path in sorted(allowed_folder(folder).glob(f"*{PUBLIC}")):
        try:
            check_name(path.stem)
            text = path.read_text().strip()
            check_key(text)
        except (OSError, UnicodeDecodeError, KeyRefused) as error:
            log.warning("the key %s is not allowed: %s", path, error)
        else:
            names.setdefault(text, path.stem)
    return names


class AllowedKeys:
    """The keys that may connect, as of the last ``refresh``."""

    def __init__(self, folder: Path) -> None:
        """Read the keys in *folder*."""
        self._folder = folder
        self._seen = self._folder_state()
        #: By public key. Replaced as a whole, so that another thread may read it.
        self.names = names_allowed(folder)

    def _folder_state(self) -> tuple[tuple[str, int, int, int], ...]:
        """Return a fingerprint of the files; () if the folder is unreadable: no key is allowed."""
        try:
            with os.scandir(allowed_folder(self._folder)) as entries:
                files = sorted((entry.name, entry.stat()) for entry in entries)
        except OSError:
            return ()
        return tuple((name, st.st_mtime_ns, st.st_size, st.st_ino) for name, st in files)

    def is_known(self, key: str) -> bool:
        """Whether a key is allowed, also by a newer file than those in ``names``.

        Any thread may call this.
        """
        return key in self.names or key in names_allowed(self._folder)

    def refresh(self) -> tuple[list[str], list[str]]:
        """Return the names whose keys were added and removed since the last call.

        A name whose key was replaced is in both lists.
        """
        state = self._folder_state()
        if state == self._seen:
            return [], []
        old_names, self._seen = self.names, state
        self.names = new_names = names_allowed(self._folder)
        added = [name for key, name in new_names.items() if old_names.get(key) != name]
        removed = [name for key, name in old_names.items() if new_names.get(key) != name]
        return added, removed
