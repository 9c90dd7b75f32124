"""Central is killed and restarted. No accepted message is lost, and none is handled twice."""

import asyncio
import errno
import os
import re
import shutil
import signal
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
import zmq
from module.real_central import until
from processes import Central, Process, central, program, tca

from dev.invariants import check_invariants
from tca_central import core
from tca_central.errors import CentralError
from tca_central.events import ConnectionId, RequestReceived, Transmit
from tca_central.shell import images
from tca_central.shell.log_writer import Sync
from tca_central.shell.recovery import recover, unfinished_segments
from tca_central.shell.run_folder import RunFolder
from tca_central.shell.server import Daemon
from tca_module import Client, Command, Query, TaskFailed, Timeout, Variable, aconnect, connect
from tca_tools.journal.journals import open_log
from tca_wire.journal import facts
from tca_wire.journal.records import record
from tca_wire.packets import codec
from tca_wire.packets.headers import PROTOCOL_VERSION, AwaitPoint, Hello, Refused
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Due, Refusal

STEP, WHERE, SPEED = (
    Command("step", int, result=int),
    Query("where", reply=int),
    Variable("speed", int),
)

LEGS = """
    import sys, time
    from pathlib import Path
    from tca_module import Command, Module, Query

    legs, done = Module("legs"), open({done!r}, "a", buffering=1)

    @legs.handles(Command("step", int, result=int))
    def step(task, number):
        done.write(f"begin {{number}}\\n")
        while number < 0 and not Path({done!r} + ".go").exists():
            time.sleep(0.005)
        done.write(f"end {{number}}\\n")
        return 2 * number

    legs.resource("eyes")

    @legs.handles(Query("where", reply=int), resource="eyes")
    def where(task):
        return 7

    with legs.running():
        print("runs", flush=True)
        sys.stdin.read()
"""


class Robot:
    """A central that can be killed, and a module that records its work in a file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.notebook = folder / "done"
        self.central = Central(folder)
        self.legs = program(LEGS.format(done=str(self.notebook)), self.central.address)
        self.legs.hear("runs")

    def kill(self) -> None:
        self.central.kill()

    def restart(self, *options: str) -> str:
        """Restart central, and return its first line."""
        self.central = Central(self.folder, *options)
        return self.central.first_line

    def starts(self) -> Counter[int]:
        words = (
            [line.split() for line in self.notebook.read_text().splitlines()]
            if self.notebook.exists()
            else []
        )
        return Counter(int(number) for word, number in words if word == "begin")

    def close(self) -> None:
        self.legs.close()
        self.central.stop()


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    running = Robot(tmp_path)
    yield running
    running.close()


@pytest.fixture
def user(robot: Robot) -> Iterator[Client]:
    with connect("user", robot.central.address, patience=20) as client:
        yield client


def test_commands_run_exactly_once_through_central_restarts(robot: Robot, user: Client) -> None:
    steps = []
    for number in range(120):
        steps.append(user.command(STEP, number))
        if number % 40 == 20:
            robot.kill()
            assert "continues the unfinished run" in robot.restart()
    assert [step.result(timeout=20) for step in steps] == [2 * number for number in range(120)]
    assert robot.starts() == Counter(range(120))
    user.close()
    robot.central.stop()
    good = tca("check", str(robot.central.journal))
    assert good.returncode == 0, good.stdout


def test_result_of_handler_is_accepted_after_central_restart(robot: Robot, user: Client) -> None:
    user.set_variable(SPEED, 3)
    step = user.command(STEP, -1)
    until(lambda: robot.starts()[-1] == 1, "the step has begun")
    after = user.command(STEP, 5)
    user.status()
    robot.kill()
    Path(f"{robot.notebook}.go").touch()
    robot.restart()
    assert step.result(timeout=20) == -2
    assert after.result(timeout=20) == 10
    assert user.get_variable(SPEED) == 3
    assert robot.starts() == Counter([-1, 5])


def test_async_awaits_continue_through_central_restart(robot: Robot) -> None:
    async def main() -> list[int]:
        async with aconnect("user", robot.central.address, patience=20) as user:
            step = await user.command(STEP, -1)
            waiting = asyncio.create_task(step.result())
            await step.wait_for(step.handling.start)
            await asyncio.to_thread(until, lambda: robot.starts()[-1] == 1, "the step has begun")
            robot.kill()
            asking = asyncio.create_task(user.query(WHERE))
            await asyncio.to_thread(Path(f"{robot.notebook}.go").touch)
            await asyncio.to_thread(robot.restart)
            async with asyncio.timeout(20):
                return [await waiting, await asking]

    assert asyncio.run(main()) == [-2, 7]


def test_task_of_dead_module_is_uncertain_after_central_restart(robot: Robot, user: Client) -> None:
    step = user.command(STEP, -1)
    until(lambda: robot.starts()[-1] == 1, "the step has begun")
    robot.kill()
    robot.legs.kill()
    robot.legs.wait()
    robot.restart()
    with pytest.raises(TaskFailed) as failed:
        step.result(timeout=20)
    assert (failed.value.failure, robot.starts()[-1]) == ("uncertain", 1)


def test_recovery_counts_a_zombie_process_as_lost(robot: Robot, user: Client) -> None:
    user.command(STEP, 1).result(timeout=20)
    robot.kill()
    robot.legs.kill()
    until(
        lambda: Path(f"/proc/{robot.legs.pid}/stat").read_text().split()[2] == "Z", "it has ended"
    )
    run = recover(robot.central.journal, unfinished_segments(robot.central.journal))
    run.central.handle(run.restarted(hold=False))
    names = {
        connection.id: connection.module.name
        for connection in run.central.registry.connections.values()
    }
    assert {names[lost.connection] for lost in run.lost_connections()} == {"legs"}


def test_resume_hold_starts_no_task_until_resumed(robot: Robot, user: Client) -> None:
    user.command(STEP, 1).result(timeout=20)
    robot.kill()
    robot.restart("--resume", "hold")
    step = user.command(STEP, 2)
    assert user.query(WHERE, timeout=20) == 7  # queries are answered
    with pytest.raises(Timeout):
        step.result(timeout=0.3)
    assert robot.starts()[2] == 0
    output = tca("status", "--central", robot.central.address).stdout
    assert "central was restarted, and starts no tasks yet" in output
    assert tca("resume", "--central", robot.central.address).stdout == "tasks start again\n"
    assert step.result(timeout=20) == 4


def test_kept_run_continues_after_a_planned_restart(robot: Robot, user: Client) -> None:
    epoch, step = user.status()["epoch"], user.command(STEP, -1)
    until(lambda: robot.starts()[-1] == 1, "the step has begun")
    stopped = tca("central", "--stop", "--keep", "--bind", robot.central.address)
    code = robot.central.process.wait(20)  # before stop(), whose SIGTERM would end it by a signal
    robot.central.stop()
    assert (stopped.returncode, code) == (0, 0), stopped.stderr
    Path(f"{robot.notebook}.go").touch()
    robot.restart()
    assert (step.result(timeout=20), user.status()["epoch"]) == (-2, epoch)
    endings = robot.central.facts(facts.CentralEnding, facts.CentralFailed, facts.Closed)
    assert endings == [facts.CentralEnding("tca central", keep=True)]
    assert robot.starts() == Counter([-1])


def test_run_is_kept_when_sigusr1_ends_central(robot: Robot, user: Client) -> None:
    epoch = user.status()["epoch"]
    robot.central.signal(signal.SIGUSR1)
    assert robot.central.process.wait() == 0
    robot.central.stop()
    robot.restart()
    assert (user.command(STEP, 3).result(timeout=20), user.status()["epoch"]) == (6, epoch)


@pytest.mark.parametrize("is_planned", [True, False])
def test_quiet_time_before_a_restart_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, is_planned: bool
) -> None:
    """The run continues at the time of its end; after a crash, at the time of the last tick."""
    folder = RunFolder(tmp_path / "journal")
    server = Daemon(folder.central, f"ipc://{tmp_path}/c.sock")
    folder.open(server, Sync.BATCH)
    server._set_limits()  # the last input before the quiet time
    monkeypatch.setattr(server, "now", lambda: 12.0)
    if is_planned:
        server.stop("SIGUSR1", keep=True)
        server.serve()
    else:
        folder.central.clock.after(60.0, Due.GRACE, None)
        server._run_due_work()
        server._flush()
        server.log = None
    server.close()
    folder.close()
    run = recover(folder.path, unfinished_segments(folder.path))
    assert run.central.clock.now == 12.0


def test_central_without_inputs_refuses_to_keep_its_run(tmp_path: Path) -> None:
    with central(tmp_path, "--no-inputs") as running:
        kept = tca("central", "--stop", "--keep", "--bind", running.address)
        assert (kept.returncode, running.process.poll()) == (1, None)
        assert "--no-inputs" in kept.stderr
        assert tca("central", "--stop", "--bind", running.address).returncode == 0
        assert running.process.wait() == 0
    assert running.facts(facts.Closed) == [facts.Closed("tca central")]


def test_ended_run_is_not_continued(tmp_path: Path) -> None:
    with central(tmp_path) as first, connect("user", first.address) as user:
        epoch = user.status()["epoch"]
    with central(tmp_path) as restarted, connect("user", restarted.address) as user:
        assert user.status()["epoch"] != epoch


def test_unnamed_journal_of_the_address_is_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    command = ["-m", "tca_central", "--bind", f"ipc://{tmp_path}/c.sock"]
    with (
        Process(*command) as first,
        connect("user", f"ipc://{tmp_path}/c.sock", patience=20) as user,
    ):
        epoch = user.status()["epoch"]
        first.kill()
        first.wait()
        with Process(*command):
            assert user.status()["epoch"] == epoch


@pytest.fixture
def broken_run(tmp_path: Path) -> Path:
    """Return the journal of a run that was killed in the middle."""
    robot = Robot(tmp_path / "robot")
    try:
        with connect("user", robot.central.address) as user:
            for number in range(10):
                user.command(STEP, number).result()
            user.command(STEP, -1)
            user.status()
            robot.kill()
    finally:
        robot.close()
    return robot.central.journal


def test_truncated_inputs_leave_a_recoverable_run(broken_run: Path, tmp_path: Path) -> None:
    """The journal then extends beyond the inputs. The option --resume facts accepts that."""
    inputs, before = (broken_run / "00000001.tcai").read_bytes(), 1 << 30
    for cut in range(len(inputs) - 1, 200, -len(inputs) // 40):
        copy = tmp_path / "copy"
        shutil.copytree(broken_run, copy)
        (copy / "00000001.tcai").write_bytes(inputs[:cut])
        run = recover(copy, unfinished_segments(copy), accept=True)
        check_invariants(run.central)
        assert run.inputs <= before, "less is left of it each time"
        assert run.central.event_count >= run.last.number
        before = run.inputs
        shutil.rmtree(copy)
    assert before < 10, "the last cut leaves little"


def test_journal_beyond_its_inputs_stops_recovery(broken_run: Path) -> None:
    journal = broken_run / "00000001.tcaj"
    (broken_run / "00000001.tcai").write_bytes((broken_run / "00000001.tcai").read_bytes()[:-200])
    before = journal.read_bytes()
    with pytest.raises(
        CentralError,
        match=r"the journal does not match the inputs.* to which no input leads.*--resume facts",
    ):
        recover(broken_run, unfinished_segments(broken_run))
    assert journal.read_bytes() == before
    recover(broken_run, unfinished_segments(broken_run), accept=True)
    aside = journal.with_suffix(".tcaj-aside").read_bytes()
    assert journal.read_bytes() + aside == before


def test_skipped_task_numbers_are_synced_before_any_reply(
    broken_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tca_central.shell.recovery.this_boot", lambda: "another")
    on_disk: list[str] = []
    sync = os.fdatasync

    def note(file: int) -> None:
        on_disk.append(Path(f"/proc/self/fd/{file}").readlink().suffix)
        sync(file)

    monkeypatch.setattr(os, "fdatasync", note)
    folder = RunFolder(broken_run)
    server = Daemon(folder.central, f"ipc://{broken_run}/c.sock")
    try:
        folder.open(server, Sync.BATCH)
        assert ".tcai" in on_disk
        lost = folder.central.tree.newest
        event = RequestReceived(
            server.now(), ConnectionId(b"new"), Hello(1, PROTOCOL_VERSION, "user", "run")
        )
        folder.central.handle(event)
        point = Point(TaskId(lost), Moment.END_ACHIEVING)
        event = RequestReceived(server.now(), ConnectionId(b"new"), AwaitPoint(2, point))
        transmitted = [
            one.header for one in folder.central.handle(event) if isinstance(one, Transmit)
        ]
        assert [one.refusal for one in transmitted if isinstance(one, Refused)] == [
            Refusal.UNKNOWN
        ], "the task may have been done"
    finally:
        server.close()
        folder.close()


def test_check_rerun_shows_the_first_difference(
    broken_run: Path,
) -> None:
    same = tca("check", "--rerun", str(broken_run))
    assert same.returncode == 0, same.stderr
    assert re.fullmatch(
        r"[\d,]+ inputs .* lead to the same [\d,]+ entries in this version\n",
        same.stdout,
    )
    journal = broken_run / "00000001.tcaj"
    entries = list(open_log(broken_run))
    changed = next(
        entry for entry in entries if any(isinstance(fact, facts.Returned) for fact in entry.facts)
    )
    changed.facts.append(facts.Ignored("user", "what never happened"))
    journal.write_bytes(b"".join(map(record, entries)))
    other = tca("check", "--rerun", str(broken_run))
    assert other.returncode == 1
    assert f"FIRST DIFFERENCE at {changed.time:.3f} s, entry {changed.number}" in other.stdout
    assert (
        "user: what never happened\n  this version's core gives\n    nothing more" in other.stdout
    )


def test_image_taken_in_recovery_is_covered_by_the_journal(
    broken_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Central is killed right after it has taken the image. By then it has written the journal up
    to the image.
    """
    monkeypatch.setattr(images, "EVENTS_BETWEEN", 2)
    run = RunFolder(broken_run)
    server = Daemon(run.central, f"ipc://{broken_run.parent}/again.sock")
    run.open(server, Sync.NONE)
    assert server.log
    assert server.log.images
    server.log.images.update(run.central)
    server.log.images.close()  # the image exists; nothing more is written
    run.close()
    server.log = None
    server.close()
    restarted = recover(broken_run, unfinished_segments(broken_run))
    assert restarted.inputs == 0
    written = [fact for entry in open_log(broken_run) for fact in entry.facts]
    assert sum(isinstance(fact, facts.CentralRestarted) for fact in written) == 1
    assert any(isinstance(fact, facts.ModuleLeft) for fact in written)


def test_client_waiting_for_restart_is_greeted_at_once(tmp_path: Path) -> None:
    """The greeting leaves at once even if much is due in the first turn. Otherwise idle slots would
    return only after 45 s.
    """
    server = Daemon(core.Central("epoch"), f"ipc://{tmp_path}/c.sock")
    server._next_beat = 0.0
    serving = Thread(target=server.serve)
    with zmq.Context() as context, context.socket(zmq.DEALER) as line:
        line.setsockopt(zmq.PROBE_ROUTER, 1)
        line.connect(server.endpoint)
        assert server.socket.poll(10_000)
        serving.start()
        is_greeted = line.poll(5_000)
        server.stop("the test ends")
        serving.join()
    server.close()
    assert is_greeted


def test_truncated_journal_is_completed_on_recovery(broken_run: Path) -> None:
    journal = broken_run / "00000001.tcaj"
    whole = journal.read_bytes()
    journal.write_bytes(whole[: len(whole) // 2])
    with central(broken_run.parent) as restarted, connect("user", restarted.address, patience=20):
        assert "continues" in restarted.first_line
    checked = tca("check", str(broken_run))
    assert checked.returncode == 0, checked.stdout


@pytest.mark.parametrize("jump", [-86_400, 31_536_000])
def test_wall_clock_jump_does_not_change_central_time(
    broken_run: Path, monkeypatch: pytest.MonkeyPatch, jump: float
) -> None:
    run = recover(broken_run, unfinished_segments(broken_run))
    now = time.time() + jump
    monkeypatch.setattr(time, "time", lambda: now)
    restarted = run.restarted(hold=False)
    assert restarted.time == run.central.clock.now
    assert restarted.away == pytest.approx(min(max(jump, 0), time.monotonic()), abs=60)


def test_restart_without_inputs_starts_a_new_run(robot: Robot, user: Client) -> None:
    user.command(STEP, -1)
    until(lambda: robot.starts()[-1] == 1, "the step has begun")
    user.command(STEP, 5)
    user.status()
    robot.kill()
    output = robot.restart("--no-inputs")
    assert "starts a new run" in output
    Path(f"{robot.notebook}.go").touch()
    robot.central.stop()
    assert "goes on" not in robot.restart()
    robot.central.stop()
    assert robot.starts()[5] == 0


@pytest.mark.parametrize("sync", [Sync.NONE, Sync.BATCH])
def test_task_numbers_are_never_reused_after_lost_inputs(broken_run: Path, sync: Sync) -> None:
    """The rule holds after unsynced inputs were lost, and after inputs were skipped."""
    newest = []
    for _ in range(2):
        folder = RunFolder(broken_run, accept=True)
        server = Daemon(folder.central, f"ipc://{broken_run}/c.sock")
        folder.open(server, sync)
        newest.append(folder.central.tree.newest)
        server.log = None  # as after a kill
        server.close()
        folder.close()
    assert newest[1] > newest[0] > 1_000_000


def test_no_packet_leaves_before_its_input_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn whose write fails sends no packet."""
    folder = RunFolder(tmp_path / "journal")
    server = Daemon(folder.central, f"ipc://{tmp_path}/c.sock")
    folder.open(server, Sync.BATCH)
    with zmq.Context() as context, context.socket(zmq.DEALER) as line:
        line.linger = 0
        line.connect(server.endpoint)
        line.send(codec.pack([(Hello(1, PROTOCOL_VERSION, "user", "secret"), b"")]))
        assert server.socket.poll(10_000)

        def fails(*_: object) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "write", fails)
        with pytest.raises(CentralError, match="No space left"):
            server.serve()
        monkeypatch.undo()
        assert not line.poll(300)
    server.close()
    folder.close()


def test_recovery_error_names_a_folder_in_place_of_a_file(broken_run: Path) -> None:
    (broken_run / "00000002.tcai").mkdir()
    with pytest.raises(CentralError, match=r"00000002\.tcai: Is a directory: name another folder"):
        RunFolder(broken_run)


def test_damaged_inputs_header_stops_recovery(
    broken_run: Path,
) -> None:
    inputs = broken_run / "00000001.tcai"
    whole = bytearray(inputs.read_bytes())
    whole[12] ^= 1
    inputs.write_bytes(whole)
    with pytest.raises(CentralError, match=r"00000001.tcai, byte 0: .* damaged"):
        RunFolder(broken_run)
    folder = RunFolder(broken_run, is_fresh=True)
    assert folder.run is None
    folder.close()
    inputs.write_bytes(whole[:20])  # central died while it created the file
    assert unfinished_segments(broken_run) == []
