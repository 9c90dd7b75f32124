"""The permissions file: TOML that says which modules each key may be, and what they may do.

Central checks the whole file before it uses any rule. A key is a name of 'tca keys', "owner" for
central's user, "uid:1001" for another user, or a list of these. Without ``module`` a rule is for
all modules of the key.

    [[allow]]
    key = "arm"
    module = "arm*"
    send = ["log", "pose"]
    handle = ["grip", "move_*"]
"""

import contextlib
import logging
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tca_central.errors import CentralError
from tca_central.events import AccessRule
from tca_wire.vocabulary import Permission

log = logging.getLogger("tca.central")

_HEADING = re.compile(r"\s*\[\[\s*allow\s*\]\]")
_NAMES = ("key", "module", *map(str, Permission))
_MOST_SHOWN = 20


class PermissionsError(CentralError):
    """A permissions file with mistakes: the text lists them, with lines and corrections."""


class PermissionsFile:
    """The rules of a file, as of its last valid version."""

    def __init__(self, path: Path) -> None:
        """Raises PermissionsError."""
        self.path = path
        self._seen = self._file_state()
        self.rules = read_rules(path)

    def _file_state(self) -> tuple[int, ...]:
        """Return a fingerprint of the file."""
        try:
            status = self.path.stat()
        except OSError as error:
            return (error.errno or 0,)
        return status.st_mtime_ns, status.st_size, status.st_ino

    def refresh(self) -> None:
        """Read the file if it has changed. If it has mistakes, log them and keep the old rules."""
        if (state := self._file_state()) == self._seen:
            return
        self._seen = state
        try:
            self.rules = read_rules(self.path)
        except PermissionsError as error:
            log.error("the permissions stay as they were: %s", error)  # noqa: TRY400 - user's error


def users_in(rules: tuple[AccessRule, ...]) -> list[int]:
    """Return the ids of the users of this computer that rules name. A pattern names no user."""
    named = [
        key.removeprefix("uid:") for rule in rules for key in rule.keys if key.startswith("uid:")
    ]
    return [int(number) for number in named if number.isdecimal()]


def read_rules(path: Path) -> tuple[AccessRule, ...]:
    """Return the rules of a file. Raises PermissionsError."""
    try:
        text, mode = path.read_text(), path.stat().st_mode
        tables = tomllib.loads(text)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise PermissionsError(f"{path}: {why}") from None
    if mode & 0o002:
        raise PermissionsError(f"{path}: every user may write it: run chmod o-w")
    if mistakes := list(_mistakes_in(tables, text)):
        lines = [
            f"{path}{f', line {line}' if line else ''}: {mistake}"
            for line, mistake in mistakes[:_MOST_SHOWN]
        ]
        raise PermissionsError("\n".join(lines))
    return tuple(map(_rule, tables["allow"]))


def _rule(table: dict[str, Any]) -> AccessRule:
    allowed = [(one, _texts(table[one])) for one in Permission if one in table]
    return AccessRule(_texts(table["key"]), _texts(table.get("module", "*")), tuple(allowed))


def _texts(value: str | list[str]) -> tuple[str, ...]:
    """Return the texts of an entry, which is a text or a list of texts."""
    return (value,) if isinstance(value, str) else tuple(value)


def _mistakes_in(content: dict[str, Any], text: str) -> Iterator[tuple[int, str]]:
    """Yield the line of each mistake (0: no particular line), and what to do."""
    for name in content.keys() - {"allow"}:
        yield (
            _line_of(text, -1, name),
            f"'{name}' has no meaning here: write [[allow]] above what it allows",
        )
    tables = content.get("allow")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        yield 0, "there is no [[allow]]: with this file no program could connect"
        return
    for index, table in enumerate(tables):
        yield from _mistakes_in_table(table, index, text)


def _mistakes_in_table(table: dict[str, Any], index: int, text: str) -> Iterator[tuple[int, str]]:
    """Yield the mistakes in the rule of that index."""
    if "key" not in table:
        yield (
            _line_of(text, index, ""),
            'the key is missing: write key = "NAME", a list of names, or "owner"',
        )
    for name, value in table.items():
        line = _line_of(text, index, name)
        if name not in _NAMES:
            yield line, f"'{name}' is no entry of a rule: use {', '.join(_NAMES)}"
        elif not _is_texts(value):
            yield (
                line,
                f'{name} = {value!r:.60} is not a text: write {name} = "NAME", or a list of texts',
            )
        elif name == "key":
            yield from ((line, what) for key in _texts(value) if (what := _mistake_in_key(key)))


def _is_texts(value: Any) -> bool:
    return isinstance(value, str) or (
        isinstance(value, list) and all(isinstance(one, str) for one in value)
    )


def _mistake_in_key(key: str) -> str:
    """Return what is wrong with a key; "" if nothing is."""
    if key.startswith("uid:") and not key.removeprefix("uid:").isdecimal():
        return f"'{key}' is not a user: write uid: and the number that 'id -u NAME' prints"
    return "" if key else "a key needs a name"


def _line_of(text: str, table: int, name: str) -> int:
    """Return the line of entry *name* ("": of the heading) in the table of that index.

    Index -1 stands for the lines before all tables. Return 0 if the entry is not found: TOML has
    many notations.
    """
    current = -1
    with contextlib.suppress(re.error):
        for number, line in enumerate(text.splitlines(), 1):
            is_heading = bool(_HEADING.match(line))
            current += is_heading
            if current == table and (
                re.match(rf"""\s*["']?{re.escape(name)}["']?\s*[=.]""", line)
                if name
                else is_heading
            ):
                return number
    return 0
