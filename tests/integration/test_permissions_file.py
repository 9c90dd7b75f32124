"""The permissions file, from its text to a running central."""

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from module.real_central import SOON, RealCentral, until
from processes import central

from tca_central.shell.gate import Gate
from tca_central.shell.permissions_file import (
    PermissionsError,
    PermissionsFile,
    read_rules,
    users_in,
)
from tca_module import Inform, Module, Query, Refused, connect
from tca_wire.journal import facts
from tca_wire.vocabulary import Permission, Refusal

WHERE, SECRET = Query("where", int, reply=int), Inform("secret", int)

GOOD = """
[[allow]]
key = ["arm", "arm-*"]
module = "arm"
send = "log"
handle = ["grip", "move_*"]

[[allow]]
key = "uid:1001"
"""

ALL = """
[[allow]]
key = "owner"
send = "*"
handle = "*"
tap = "*"
lock = "*"
kill = "*"
administer = "*"
"""

LITTLE = """
[[allow]]
key = "owner"
module = "map"
handle = "where"

[[allow]]
key = "owner"
module = "user"
send = "where"
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "robot.toml"


def test_permissions_file_is_parsed_into_rules(path: Path) -> None:
    path.write_text(GOOD)
    arm, user = read_rules(path)
    assert (arm.keys, arm.modules) == (("arm", "arm-*"), ("arm",))
    assert dict(arm.allowed) == {Permission.SEND: ("log",), Permission.HANDLE: ("grip", "move_*")}
    assert (user.keys, user.modules, user.allowed) == (("uid:1001",), ("*",), ())
    assert users_in((arm, user)) == [1001]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("[[allow]\n", 1, "Expected"),
        ("", 0, r"there is no \[\[allow\]\]"),
        ("allow = 3", 0, r"there is no \[\[allow\]\]"),
        ("[[allow]]\nsend = 'x'\n", 1, "the key is missing"),
        ("[[allow]]\nkey = 'x'\n\n[[allow]]\nkey = 'y'\nsned = 'z'\n", 6, "'sned' is no entry of a rule: use .*send"),
        ("[[allow]]\nkey = 'x'\nsend = 7\n", 3, "send = 7 is not a text"),
        ("[[allow]]\nkey = 'x'\nkill = ['a', 1]\n", 3, 'write kill = "NAME", or a list'),
        ("[[allow]]\nkey = 'uid:root'\n", 2, "'uid:root' is not a user: write uid: and the number"),
        ("[[allow]]\nkey = ''\n", 2, "a key needs a name"),
        ("deny = 'x'\n[[allow]]\nkey = 'x'\n", 1, "'deny' has no meaning here"),
    ],
)  # fmt: skip
def test_permissions_error_names_the_line(path: Path, text: str, line: int, words: str) -> None:
    path.write_text(text)
    where = rf", line {line}: " if line > 1 or "[[allow]]" in text else ""
    with pytest.raises(PermissionsError, match=rf"robot.toml{where}.*{words}"):
        read_rules(path)


def test_permissions_error_lists_all_mistakes(path: Path) -> None:
    path.write_text("[[allow]]\nsned = 'x'\n[[allow]]\nkey = 3\n")
    with pytest.raises(PermissionsError) as caught:
        read_rules(path)
    assert str(caught.value).count("robot.toml, line") == 3


def test_missing_or_world_writable_permissions_are_refused(path: Path) -> None:
    with pytest.raises(PermissionsError, match="No such file"):
        read_rules(path)
    path.write_text(ALL)
    path.chmod(0o666)
    with pytest.raises(PermissionsError, match="every user may write it"):
        read_rules(path)


def test_central_does_not_start_with_invalid_permissions(tmp_path: Path, path: Path) -> None:
    path.write_text("[[allow]]\nkye = 'x'\n")
    with central(tmp_path / "run", "--permissions", str(path)) as daemon:
        assert daemon.process.wait(SOON) == 1
        assert "robot.toml, line 1" in daemon.first_line


@pytest.fixture
def running(path: Path, tmp_path: Path) -> Iterator[RealCentral]:
    path.write_text(LITTLE)
    file = tmp_path / "central.sock"
    with RealCentral(f"ipc://{file}", gate=Gate(PermissionsFile(path), file)) as running:
        yield running


def changed(running: RealCentral, count: int) -> None:
    running.server.check_soon()
    until(
        lambda: len(running.facts(facts.PermissionsChanged)) >= count,
        "the permissions have changed",
    )


def test_changed_permissions_apply_to_a_running_central(
    running: RealCentral, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    a_map = Module("map", running.address)
    a_map.handles(WHERE)(lambda _, number: number + 1)
    with a_map.running(), connect("user", running.address) as user:
        assert user.query(WHERE, 1, timeout=SOON) == 2
        with pytest.raises(
            Refused, match="module 'user' may not declare 'secret': see the permissions file"
        ) as caught:
            user.inform(SECRET, 1)
        assert caught.value.refusal is Refusal.FORBIDDEN
        with pytest.raises(Refused, match="'owner' may not be module 'other'"):
            connect("other", running.address)
        path.write_text(ALL)
        changed(running, 2)
        user.inform(SECRET, 1)
        connect("other", running.address).close()
        path.write_text("nonsense")
        running.server.check_soon()
        until(lambda: "the permissions stay as they were" in caplog.text, "the log tells of it")
        user.inform(SECRET, 2)
        path.write_text(LITTLE)
        changed(running, 3)
        with pytest.raises(Refused):
            user.status()
    refused = [
        fact for fact in running.facts(facts.RequestRefused) if fact.refusal is Refusal.FORBIDDEN
    ]
    assert len(refused) >= 3


def test_sighup_makes_central_reload_permissions(tmp_path: Path, path: Path) -> None:
    path.write_text(LITTLE)
    with central(tmp_path / "run", "--permissions", str(path)) as daemon:
        with pytest.raises(Refused):
            connect("other", daemon.address)
        path.write_text(ALL)
        os.kill(daemon.process.pid, signal.SIGHUP)

        def is_let_in() -> bool:
            with suppress(Refused):
                connect("other", daemon.address).close()
                return True
            return False

        until(is_let_in, "the permissions have changed")
        assert "permissions from" in daemon.stop()


def test_sighup_ends_central_when_its_terminal_is_closed(tmp_path: Path) -> None:
    """If central has a terminal, a hangup means the end rather than a reload."""
    near, far = pty.openpty()
    command = [
        sys.executable,
        "-m",
        "tca_central",
        "--bind",
        f"ipc://{tmp_path}/central.sock",
        "--no-journal",
    ]
    with subprocess.Popen(
        command, stdin=far, stdout=far, stderr=far, start_new_session=True
    ) as daemon:
        os.close(far)
        assert b"listening" in os.read(near, 100)
        os.kill(daemon.pid, signal.SIGHUP)
        connect("user", f"ipc://{tmp_path}/central.sock").close()
        assert daemon.poll() is None
        os.close(near)
        os.kill(daemon.pid, signal.SIGHUP)  # as the kernel does to processes of a closed terminal
        assert daemon.wait(SOON) in (0, 120)  # 120: Python could not flush its output
