"""TOML files of users: keys, permissions, robots. Each is read, or refused with its own error."""

import contextlib
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import TEXTS, damaged
from tca_behaviours.activities.models.reading import read_model
from tca_central.shell.permissions_file import PermissionsError, read_rules, users_in
from tca_tools.errors import BadUserFile
from tca_tools.supervise.robot_file import load
from tca_wire.errors import KeyRefused
from tca_wire.keys import read_client_key

_WORDS = (
    "allow",
    "key",
    "module",
    "send",
    "handle",
    "tap",
    "lock",
    "kill",
    "administer",
    "central",
    "modules",
    "run",
    "legs",
    "start",
    "address",
    "journal",
    "options",
    "command",
    "cwd",
    "env",
    "restarts",
    "within",
    "delay",
    "grace",
    "copies",
    "public",
    "secret",
    "name",
    "pulse",
    "uid:1001",
    "uid:x",
    "owner",
    "*",
    "ipc:///x/central.sock",
    "tcp://127.0.0.1:5",
    "always",
    "{",
    "python x.py",
    "x" * 40,
)
_MOST_LINES = 30


def _value(choices: Choices, depth: int = 0) -> str:
    kind = choices.below(10)
    if kind < 4 or depth > 3:
        return json.dumps(choices.one_of(_WORDS if kind else TEXTS))
    if kind < 6:
        return f"[{', '.join(_value(choices, depth + 1) for _ in range(choices.below(4)))}]"
    if kind == 6:
        fields = (
            f"{choices.one_of(_WORDS[:29])} = {_value(choices, depth + 1)}"
            for _ in range(choices.below(3))
        )
        return f"{{{', '.join(fields)}}}"
    return choices.one_of(
        (
            "0",
            "1",
            "-1",
            "1e400",
            "nan",
            "true",
            "false",
            "9" * 30,
            "1979-05-27",
            "07:32:00",
            "0.5",
            "[" * 2000,
        )
    )


def _text(choices: Choices) -> bytes:
    lines: list[str] = []
    while not choices.is_over and len(lines) < _MOST_LINES:
        kind, word = choices.below(8), choices.one_of(_WORDS[:29])
        headings = ("[[allow]]", f"[modules.{word}]", f"[{word}]")
        lines.append(headings[kind] if kind < 3 else f"{word} = {_value(choices)}")
    text = "\n".join(lines).encode(errors="surrogatepass")
    return damaged(text, choices) if choices.once_in(8) else text


def _read_rules(path: Path) -> None:
    users_in(read_rules(path))


_READERS: tuple[tuple[Callable[[Path], Any], type[Exception]], ...] = (
    (_read_rules, PermissionsError),
    (load, BadUserFile),
    (read_model, BadUserFile),
    (read_client_key, KeyRefused),
)


def attack(data: bytes) -> None:
    """Read a file that is made of known words."""
    text = _text(Choices(data))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "file.toml")
        path.touch(0o600)
        path.write_bytes(text)
        for read, error in _READERS:
            with contextlib.suppress(error):
                read(path)
