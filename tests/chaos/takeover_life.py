"""The life of a robot whose central is one of three with a replicated log, and moves all the time.

Centrals and the servers of the log are killed and stopped, and the lines between them are cut or
hold what is sent.
"""

import re
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from chaos.life import HEALED, Broken, Life
from chaos.lines import Line, Lines
from nats_servers import NatsServers
from processes import Process

NAMES = "a", "b", "c"
LEADS = re.compile(
    rb"(leads now)|(listening on)|(follows the log;)|(another central leads)|(removed)"
)
FAULTS = {
    "kill leader": 6,
    "stop leader": 3,
    "cut leader": 3,
    "hold leader": 4,
    "cut one line": 1,
    "hold one line": 1,
    "kill standby": 2,
    "stop standby": 1,
    "cut standby": 1,
    "hold standby": 1,
    "kill server": 2,
    "stop server": 2,
    "cut server": 1,
    "hold server": 1,
}
"""The kinds of faults, and how frequent they are."""
YOUNG = 10.0
"""Seconds in which a standby may not have followed yet, on a busy machine."""


class Member:
    """One of the centrals."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name = name
        self.bind = self.address = f"ipc://{folder}/{name}.sock"
        self.front: Line | None = None  #: between this central and all programs, over TCP
        self.log = folder / f"central-{name}.log"
        self.log.touch()
        self.lines: list[Line] = []  #: to the servers of the log
        self.computers = 0  #: that it has run on before
        self.read = 0  #: bytes of the log that were read
        self.process: Process | None = None
        self.is_faulty = False  #: whether it is stopped, or its lines are broken
        self.listens, self.started = False, 0.0
        self.term = 0  #: the number of the takeover with which it leads; 0: it follows


class TakeoverLife(Life):
    """One life, with a given number of takeovers.

    In every other life centrals listen at TCP ports, so that the lines to programs fail, too.
    """

    module_seconds = 20.0

    def __init__(
        self,
        folder: Path,
        seed: int,
        takeovers: int,
        *,
        users: int = 2,
        events_between: int = 500,
        faults: dict[str, int] | None = None,
        seconds: Sequence[float] = (0.3, 1.5, 3.0, 5.0),
    ) -> None:
        super().__init__(folder, seed, takeovers, users=users, events_between=events_between)
        self._faults, self._seconds = faults or FAULTS, seconds
        self.stops = [min(stop, seconds[-1]) for stop in self.stops]
        self.lines = Lines()
        self._routes: list[tuple[int, int, Line]] = []
        self.servers = NatsServers(folder, route=self._route)
        self.has_fronts = bool(seed % 2)
        self.members = [Member(name, folder) for name in NAMES]
        for one in self.members:
            one.lines = [
                self.lines.add(f"{one.name}{number}", port)
                for number, port in enumerate(self.servers.ports)
            ]
            if self.has_fronts:
                port = self.servers.held_port()
                one.front = self.lines.add(f"{one.name}-programs", port)
                one.bind = f"tcp://127.0.0.1:{port}"
                one.address = f"tcp://127.0.0.1:{one.front.port}"
        self.address = ",".join(one.address for one in self.members)
        self.leader = self.members[0]
        self._faulty_servers = set[int]()
        self._repairs: list[tuple[float, Callable[[], None]]] = []

    def _route(self, one: int, other: int, port: int) -> int:
        line = self.lines.add(f"route{one}{other}", port)
        self._routes.append((one, other, line))
        return line.port

    def run(self) -> None:
        """Run the life: faults, heal, end. Raise Broken if something fails that must not."""
        try:
            self._begin()
            while self.counts["takeovers"] < self.kills:
                self._meet_fault()
            self._heal()
        finally:
            for process in self._processes:
                process.close()
            self.servers.close()
            self.lines.close()

    @property
    def journals(self) -> list[Path]:
        """The folders of the journals of all centrals."""
        return sorted(path.parent for path in self.folder.glob("journal-*/00000001.tcaj"))

    # --- centrals ---------------------------------------------------------------------------------

    def _start_central(self) -> None:
        self._start_member(self.leader, "central")
        self._await_leader()
        for one in self.members[1:]:
            self._start_member(one, "standby")

    def _start_member(self, member: Member, command: str = "standby") -> None:
        if self.random.random() < 0.2:  # a new computer takes its place
            member.computers += 1
        journal = self.folder / f"journal-{member.name}{member.computers}"
        servers = ",".join(f"127.0.0.1:{line.port}" for line in member.lines)
        options = ["--log", f"nats://{servers}/robot", "--bind", member.bind]
        options += ["--journal", str(journal), *["--insecure"] * bool(member.front)]
        member.process = self._start(
            f"central-{member.name}", "be_member", command, self._events_between, options
        )
        member.listens, member.started = False, time.monotonic()

    def _read_logs(self) -> None:
        """Note who leads. Raise Broken if a central has ended that must not."""
        for one in self.members:
            with one.log.open("rb") as log:
                log.seek(one.read)
                text = log.read()
            text = text[: text.rfind(b"\n") + 1]
            one.read += len(text)
            for found in LEADS.finditer(text):
                leads, listens, follows, is_deposed, is_behind = found.groups()
                if leads:
                    self.counts["takeovers"] += 1
                    one.term = self.counts["takeovers"]
                    self._log(f"central {one.name} leads, takeover {self.counts['takeovers']}")
                if listens or follows:
                    one.listens = bool(listens)
                if follows:
                    one.term = 0
                self.counts["centrals deposed"] += bool(is_deposed)
                self.counts["centrals left behind"] += bool(is_behind)
        # One that was deposed before it said that it leads may say so last, but then follows.
        self.leader = max(self.members, key=lambda one: one.term)

    def _check_central(self) -> None:
        self._read_logs()
        for one in self.members:
            if one.process is not None and (status := one.process.poll()) is not None:
                raise Broken(f"central {one.name} has ended with {status}; see {one.log}")

    def _await_leader(self) -> None:
        """Let time pass until a central leads and works."""
        until = time.monotonic() + HEALED
        while not self.leader.listens or self.leader.is_faulty or self.leader.process is None:
            if time.monotonic() > until:
                raise Broken("no central leads")
            self._pass(0.01)

    # --- faults -----------------------------------------------------------------------------------

    def _meet_fault(self) -> None:
        if self.random.random() < 0.9:
            self._await_leader()
            self._pass(2 * self.random.random() ** 2)
        else:
            self._pass(self.random.random())
        kind = self.random.choices(list(self._faults), list(self._faults.values()))[0]
        seconds = self.random.choice(self._seconds) * (0.5 + self.random.random())
        self.fault(kind, seconds / 2 if kind.startswith("kill") else seconds)

    def fault(self, kind: str, seconds: float) -> None:
        """Let something fail, and be repaired after some seconds."""
        how, _, what = kind.partition(" ")
        if what == "server":
            self._server_fails(how, seconds, self.random.randrange(3))
            return
        others = [one for one in self.members if one is not self.leader]
        member = self.random.choice(others) if what == "standby" else self.leader
        if member.is_faulty or member.process is None:
            return
        self.counts[kind] += 1
        if how == "kill":
            self._log(f"central {member.name} killed")
            member.process.close()
            member.process, member.term = None, 0
            self._repair_after(seconds, f"start {member.name}", lambda: self._start_member(member))
            return
        if what == "one line":
            self._break([self.random.choice(member.lines)], how, seconds)
            return
        member.is_faulty = True
        if how == "stop":
            member.process.send_signal(signal.SIGSTOP)
            self._log(f"central {member.name} stopped")
        else:
            front = [member.front] if member.front and self.random.random() < 0.5 else []
            self._break([*member.lines, *front], how, seconds)
        self._repair_after(seconds, f"{member.name} is well", lambda: self._is_well(member))

    def _is_well(self, member: Member) -> None:
        member.is_faulty = False
        if member.process is not None:
            member.process.send_signal(signal.SIGCONT)

    def _break(self, lines: list[Line], how: str, seconds: float) -> None:
        there, back = self.random.choice([(True, True), (True, False), (False, True)])
        drops = self.random.random() < 0.5
        names = " ".join(line.name for line in lines)
        self._log(f"{how} {names}" + (f", there {there}, back {back}" if how == "hold" else ""))
        for line in lines:
            line.cut() if how == "cut" else line.hold(there=there, back=back)

        def mend() -> None:
            for line in lines:
                line.mend(drops=drops)

        self._repair_after(seconds, f"mend {names}", mend)

    def _server_fails(self, how: str, seconds: float, number: int) -> None:
        if number in self._faulty_servers:
            return
        if self._faulty_servers:  # the log has no majority
            seconds = min(seconds, 1.5)
        self.counts[f"{how} server"] += 1
        self._faulty_servers.add(number)
        if how in ("cut", "hold"):
            self._break([line for *ends, line in self._routes if number in ends], how, seconds)
        else:
            {"kill": self.servers.kill, "stop": self.servers.stop}[how](number)
            self._log(f"server {number}: {how}")

        def repair() -> None:
            self._faulty_servers.discard(number)
            if how == "kill":
                self.servers.start(number)
            else:
                self.servers.resume(number)

        self._repair_after(seconds, f"server {number} is well", repair)

    def _repair_after(self, seconds: float, what: str, repair: Callable[[], object]) -> None:
        def repair_and_log() -> None:
            self._log(what)
            repair()

        self._repairs.append((time.monotonic() + seconds, repair_and_log))

    def _do_due(self, now: float) -> None:
        super()._do_due(now)
        for due, repair in [one for one in self._repairs if one[0] <= now]:
            self._repairs.remove((due, repair))
            repair()
        self._check_central()

    # --- the end ----------------------------------------------------------------------------------

    def _heal(self) -> None:
        while self._repairs:
            self._pass(0.05)
        self._await_leader()
        super()._heal()

    def _end_central(self) -> None:
        """End the leader and so the run; the standbys end with it.

        A young standby may not have read of the run before its end: it then waits for another one.
        """
        assert self.leader.process is not None
        self.leader.process.send_signal(signal.SIGINT)  # SIGTERM would leave the run to a standby
        self.leader.process.wait()
        for one in self.members:
            assert one.process is not None
            is_young = one is not self.leader and time.monotonic() < one.started + YOUNG
            if is_young:
                one.process.terminate()
            if (status := one.process.wait()) and not (is_young and status == -signal.SIGTERM):
                raise Broken(f"central {one.name} ended with {status}; see {one.log}")
