"""Access control: keys over TCP, and user ids from the kernel over Unix sockets.

Central accepts no connection whose key cannot be checked.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
import zmq
from click.testing import CliRunner
from module.real_central import SOON, RealCentral, until
from nats_servers import free_port
from processes import central, tca

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, KeysChanged, RequestReceived
from tca_central.shell.authenticator import Authenticator, new_pair
from tca_central.shell.gate import Gate, KeyGate
from tca_central.shell.keys_command import keys as keys_command
from tca_central.shell.permissions_file import PermissionsFile
from tca_module import (
    CentralLost,
    Client,
    Command,
    MisuseError,
    Module,
    Query,
    Refusal,
    Refused,
    connect,
)
from tca_wire.journal import facts
from tca_wire.keys import read_client_key
from tca_wire.packets import headers

SQUARE = Query("square", int, reply=int)
TCP = "tcp://127.0.0.1:*"


def run_keys(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(keys_command, arguments)
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a folder of keys with one for 'arm' and one for 'user'."""
    monkeypatch.setenv("TCA_KEYS", str(tmp_path / "keys"))
    run_keys("new", "arm")
    run_keys("new", "user")
    return tmp_path / "keys"


@pytest.fixture
def keyed(folder: Path) -> Iterator[RealCentral]:
    with RealCentral(TCP, gate=KeyGate(folder)) as running:
        yield running


@pytest.fixture
def as_key(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    return lambda name: monkeypatch.setenv("TCA_KEY", name)


def refusal(address: str) -> str:
    with pytest.raises(CentralLost) as caught:
        connect("stranger", address, patience=0.3)
    return str(caught.value)


def test_connection_is_identified_by_its_key(
    keyed: RealCentral, as_key: Callable[[str], None]
) -> None:
    for name in ("arm", "user"):
        as_key(name)
        with connect(f"the {name}", keyed.address) as client:
            assert client.status()["modules"] == 1
    joined = [(fact.module, fact.principal) for fact in keyed.facts(facts.ModuleJoined)]
    assert joined == [("the arm", "arm"), ("the user", "user")]


def test_key_is_shown_to_central_at_each_address_of_a_list(
    folder: Path, as_key: Callable[[str], None]
) -> None:
    as_key("arm")
    with RealCentral(TCP, gate=KeyGate(folder)) as first:
        other = f"tcp://127.0.0.1:{free_port()}"
        listed = f"{first.address},{other}"
        with connect("arm", listed, patience=SOON) as user:
            first.close()
            with RealCentral(other, gate=KeyGate(folder)) as second:
                user.modules()
                assert user.address == second.address
                assert {one.principal for one in second.facts(facts.ModuleJoined)} == {"arm"}


def test_keyed_module_connects_its_slots_and_heartbeat(
    keyed: RealCentral, as_key: Callable[[str], None]
) -> None:
    as_key("arm")
    module = Module("squares", keyed.address)
    module.handles(SQUARE)(lambda _, number: number * number)
    with module.running(), connect("user", keyed.address) as user:
        assert user.query(SQUARE, 12, timeout=SOON) == 144
        known = keyed.server.central.registry.connections.values()
        assert {one.principal for one in known} == {"arm"}
        pulses = {one.pulse for one in known}

        def is_met() -> bool:
            keyed.server.check_soon()
            return pulses <= keyed.server._pulses._reached

        until(is_met, "the pulse is there")


def test_connection_is_refused_without_a_matching_key(
    keyed: RealCentral, folder: Path, as_key: Callable[[str], None], tmp_path: Path
) -> None:
    as_key("none")
    assert "it wants a key, and this program shows none" in refusal(keyed.address)
    stranger = tmp_path / "elsewhere"
    run_keys("new", "--folder", str(stranger), "arm")
    other = read_client_key(stranger / "arm.key")
    as_key(str(stranger / "arm.key"))
    assert "is not the central that the key is for" in refusal(keyed.address)
    ours = read_client_key(folder / "arm.key")
    forged = stranger / "forged.key"
    forged.write_text(
        f'name = "arm"\npublic = "{other.public}"\nsecret = "{other.secret}"\ncentral = "{ours.central}"\n'
    )
    forged.chmod(0o600)
    as_key(str(forged))
    assert "it does not allow the key 'arm'" in refusal(keyed.address)
    with RealCentral(TCP) as open_to_all:
        assert "or wants no key" in refusal(open_to_all.address)
    assert not keyed.facts(facts.ModuleJoined)


def test_waiting_program_connects_once_its_key_is_allowed(
    keyed: RealCentral,
    folder: Path,
    as_key: Callable[[str], None],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    central_key = read_client_key(folder / "arm.key").central
    path, _ = run_keys(
        "new", "late", "--central", central_key, "--folder", str(tmp_path / "there")
    ).splitlines()
    as_key(path)
    with ThreadPoolExecutor() as threads:
        late = threads.submit(lambda: connect("late", keyed.address, patience=30).close())
        until(lambda: "refused a key from 127.0.0.1" in caplog.text, "it is refused")
        run_keys("allow", "late", read_client_key(Path(path)).public)
        late.result(timeout=30)


def test_connections_are_refused_when_authenticator_is_dead(
    keyed: RealCentral, as_key: Callable[[str], None]
) -> None:
    as_key("user")
    with connect("early", keyed.address) as early:
        gate = keyed.server._gate
        assert isinstance(gate, KeyGate)
        assert gate._authenticator is not None
        gate._authenticator.close()
        for name in ("arm", "user", "none"):
            as_key(name)
            assert refusal(keyed.address)
        assert early.status()["modules"] == 1, "those who are there go on"
        assert not gate.is_alive


def test_central_does_not_start_when_authenticator_accepts_all(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        Authenticator, "_answer", lambda _, request: [b"1.0", request[1], b"200", b"OK", b"x", b""]
    )
    with pytest.raises(Exception, match="an unknown key was let in when tried"):
        RealCentral(TCP, gate=KeyGate(folder))


def test_revoke_keeps_the_secret_key_file(folder: Path) -> None:
    secret = read_client_key(folder / "arm.key")
    output = run_keys("revoke", "arm")
    assert str(folder / "arm.key") in output
    assert read_client_key(folder / "arm.key") == secret
    assert "remove that file" in run_keys("new", "arm", code=1)
    run_keys("allow", "arm", secret.public)
    assert secret.public in run_keys("list")


def test_revoked_key_loses_its_connection_at_once(
    keyed: RealCentral, folder: Path, as_key: Callable[[str], None]
) -> None:
    as_key("user")
    user = connect("user", keyed.address)
    as_key("arm")
    arm = connect("arm", keyed.address, patience=0.5)
    run_keys("revoke", "arm")
    keyed.server.check_soon()
    until(lambda: keyed.facts(facts.ModuleLeft), "the arm has left")
    (left,) = keyed.facts(facts.ModuleLeft)
    assert (left.module, left.lost) == ("arm", True)
    assert "not allowed any more" in left.why
    assert keyed.facts(facts.KeysChanged) == [facts.KeysChanged([], ["arm"])]
    assert is_shut_out(arm.status)
    assert user.status()["modules"] == 1
    # A new key with this name is accepted at once. The old connection stays refused.
    (folder / "arm.key").unlink()
    run_keys("new", "arm")
    with connect("new arm", keyed.address):
        pass
    assert is_shut_out(arm.status)
    assert [fact.module for fact in keyed.facts(facts.ModuleJoined)].count("arm") == 1
    user.close()
    arm.close()


def is_shut_out(call: Callable[[], object]) -> bool:
    """Whether a call is refused because central has shut its connection out."""
    with pytest.raises(Refused) as refused:
        call()
    return refused.value.refusal is Refusal.SHUT_OUT


TURN = Command("turn", result=int)
WAITS: list[Callable[[Client], object]] = [
    lambda client: client.command(TURN).result(),
    lambda client: client.command(TURN).wait(),
    lambda client: list(client.command(TURN).changes()),
    lambda client: client.query(SQUARE, 3, timeout=3 * SOON),
    lambda client: client.wait_until_handled(SQUARE, timeout=3 * SOON),
]


def test_revoked_client_is_shut_out_of_every_wait(
    keyed: RealCentral, folder: Path, as_key: Callable[[str], None]
) -> None:
    def are_shut_out(wait: Callable[[Client], object]) -> list[bool]:
        with connect("user", keyed.address) as client:
            return [is_shut_out(partial(wait, client)), is_shut_out(client.status)]

    as_key("user")
    lines = keyed.server.central.registry.connections
    with ThreadPoolExecutor(len(WAITS)) as threads:
        clients = [threads.submit(are_shut_out, wait) for wait in WAITS]
        until(
            lambda: sum(len(line.outstanding) for line in list(lines.values())) == len(WAITS),
            "all wait",
        )
        run_keys("revoke", "user")
        keyed.server.check_soon()
        assert [client.result(SOON) for client in clients] == [[True, True]] * len(WAITS)


def test_revoked_module_reconnects_once_its_key_is_allowed(
    keyed: RealCentral,
    folder: Path,
    as_key: Callable[[str], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    as_key("arm")
    public = read_client_key(folder / "arm.key").public
    module = Module("squares", keyed.address)
    module.handles(SQUARE)(lambda _, number: number * number)
    with module.running():
        run_keys("revoke", "arm")
        keyed.server.check_soon()
        until(lambda: "central refuses this module" in caplog.text, "it is shut out")
        run_keys("allow", "arm", public)
        as_key("user")
        with connect("user", keyed.address) as user:
            assert user.query(SQUARE, 12, timeout=SOON) == 144


def test_key_removed_during_downtime_is_revoked_on_restart(folder: Path) -> None:
    known = Central()
    for name in ("arm", "ghost"):
        hello = headers.Hello(1, headers.PROTOCOL_VERSION, name, f"run of {name}")
        known.handle(RequestReceived(0.0, ConnectionId(name.encode()), hello, principal=name))
    gate = KeyGate(folder)
    changed, lost = gate.changes(1.0, known)
    assert changed == KeysChanged(1.0, [], ["ghost"])
    assert isinstance(lost, ConnectionLost)
    assert lost.connection == b"ghost"
    known.handle(lost)
    assert list(gate.changes(2.0, known)) == []


def test_central_without_allowed_keys_does_not_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TCA_KEYS", str(tmp_path / "keys"))
    for bind in ("tcp://127.0.0.1:*", "tcp://0.0.0.0:*"):
        with central(tmp_path, bind=bind) as daemon:
            assert daemon.process.wait(SOON) == 1
            assert "'tca keys new NAME'" in daemon.first_line


def test_second_machine_is_set_up_in_five_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TCA_KEYS", str(tmp_path / "robot"))
    assert run_keys("new", "laptop").strip() == str(tmp_path / "robot" / "laptop.key")
    with central(tmp_path, bind="tcp://0.0.0.0:*") as daemon:
        port = daemon.first_line.rpartition(":")[2]
        copied = tmp_path / "laptop.key"
        copied.write_bytes((tmp_path / "robot" / "laptop.key").read_bytes())  # as after scp
        monkeypatch.setenv("TCA_KEYS", str(tmp_path / "laptop"))
        assert "'laptop'" in run_keys("use", str(copied))
        monkeypatch.setenv("TCA_CENTRAL", f"tcp://127.0.0.1:{port}")
        assert "0 modules" in (status := tca("status")).stdout, status


# --- the files ------------------------------------------------------------------------------------


def test_key_files_are_private_and_never_overwritten(folder: Path) -> None:
    modes = {path.name: path.stat().st_mode & 0o777 for path in [folder, *folder.rglob("*")]}
    assert modes == {
        "keys": 0o700,
        "allowed": 0o700,
        "central.key": 0o600,
        "arm.key": 0o600,
        "user.key": 0o600,
        "arm.pub": 0o600,
        "user.pub": 0o600,
    }
    before = {path: path.read_bytes() for path in folder.rglob("*.*")}
    assert "'arm' has a key" in run_keys("new", "arm", code=1)
    run_keys("use", str(folder / "arm.key"))
    assert "exists already: move it away first" in run_keys("use", str(folder / "user.key"), code=1)
    assert {path: path.read_bytes() for path in before} == before
    listed = run_keys("list")
    assert read_client_key(folder / "arm.key").public in listed
    assert read_client_key(folder / "arm.key").secret not in listed


def test_generated_public_key_never_starts_with_a_dash(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = iter([(b"-" + b"x" * 39, b"s" * 40), (b"y" * 40, b"t" * 40)])
    monkeypatch.setattr(zmq, "curve_keypair", lambda: next(pairs))
    assert new_pair() == ("y" * 40, "t" * 40)


def test_foreign_key_is_allowed_by_its_public_half(folder: Path) -> None:
    public = new_pair().public
    run_keys("allow", "planner", public)
    assert f"planner    {public}" in run_keys("list")
    assert "that is the key of 'planner'" in run_keys("allow", "other", public, code=1)
    assert "is not a public key" in run_keys("allow", "other", "short", code=1)


def test_key_works_without_moving_its_secret(
    folder: Path, tmp_path: Path, as_key: Callable[[str], None]
) -> None:
    there = tmp_path / "laptop"
    central_key = run_keys("list").split()[1]
    path, advice = run_keys(
        "new", "laptop", "--central", central_key, "--folder", str(there)
    ).splitlines()
    assert run_keys("list", "--folder", str(there)).count("\n") == 1, "the key is not allowed there"
    name, public = advice.split()[-2:]
    run_keys("allow", name, public.strip("'"))
    as_key(path)
    with RealCentral(TCP, gate=KeyGate(folder)) as running, connect("x", running.address):
        assert [fact.principal for fact in running.facts(facts.ModuleJoined)] == ["laptop"]


@pytest.mark.parametrize(
    "name", ["", "../arm", "a b", "central", "owner", "none", "x" * 65, ".hidden", "uid:0"]
)
def test_keys_new_rejects_invalid_name(folder: Path, name: str) -> None:
    assert "can't be the name of a key" in run_keys("new", "--", name, code=1)


def test_key_files_readable_by_others_are_refused(
    folder: Path, as_key: Callable[[str], None]
) -> None:
    (folder / "arm.key").chmod(0o644)
    as_key("arm")
    with pytest.raises(MisuseError, match=r"others may read the key .*arm.key: chmod 600"):
        connect("arm", "tcp://127.0.0.1:1")
    as_key("nobody")
    with pytest.raises(MisuseError, match=r"can.t read the key .*nobody.key"):
        connect("arm", "tcp://127.0.0.1:1")
    folder.chmod(0o755)
    assert "others may enter" in run_keys("new", "leg", code=1)
    folder.chmod(0o700)


# --- users of this computer -----------------------------------------------------------------------

KNOCK = """
import os, sys, zmq
from tca_wire.packets import codec, headers
os.setgid(65534), os.setuid(65534)
socket = zmq.Context().socket(zmq.DEALER)
socket.linger = 0
socket.connect(sys.argv[1])
socket.send(codec.pack([(headers.Hello(1, headers.PROTOCOL_VERSION, "knocker", "x"), b"")]))
print(*[header for header, _ in codec.unpack_to_module(socket.recv())] if socket.poll(10_000) else ["silence"], flush=True)
os._exit(0)
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
def test_other_user_is_refused_on_a_world_writable_socket() -> None:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        with RealCentral(f"ipc://{folder}/central.sock") as running:
            Path(folder, "central.sock").chmod(0o777)
            command = [sys.executable, "-c", KNOCK, running.address]
            answer = subprocess.run(
                command, capture_output=True, text=True, timeout=60, check=False
            )
            assert "central lets in no programs of other users" in answer.stdout, answer
            assert not running.facts(facts.ModuleJoined)
            with connect("user", running.address) as user:
                assert user.status()["modules"] == 1


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
def test_other_user_is_accepted_only_while_permitted() -> None:
    owner, nobody = (
        '[[allow]]\nkey = "owner"\nadminister = "*"\n',
        '[[allow]]\nkey = "uid:65534"\nmodule = "knocker"\n',
    )
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        rules, file = Path(folder, "robot.toml"), Path(folder, "central.sock")
        rules.write_text(owner + nobody)
        with RealCentral(f"ipc://{file}", gate=Gate(PermissionsFile(rules), file)) as running:
            command = [sys.executable, "-c", KNOCK, running.address]
            answer = subprocess.run(
                command, capture_output=True, text=True, timeout=60, check=False
            )
            assert "Welcome" in answer.stdout, answer
            joined = [(fact.module, fact.principal) for fact in running.facts(facts.ModuleJoined)]
            assert joined == [("knocker", "uid:65534")]
            rules.write_text(owner)
            running.server.check_soon()
            until(lambda: len(running.facts(facts.PermissionsChanged)) >= 2, "the rules are read")
            assert file.stat().st_mode & 0o077 == 0
            file.chmod(0o777)
            answer = subprocess.run(
                command, capture_output=True, text=True, timeout=60, check=False
            )
            assert "central lets in no programs of other users" in answer.stdout, answer
