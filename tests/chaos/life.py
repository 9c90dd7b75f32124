"""The life of a robot under load. Its central and modules are killed and stopped at random."""

import signal
import time
from collections import Counter
from pathlib import Path
from random import Random

from chaos.robot import MODULES
from processes import Process

from tca_module import connect

HEALED = 120.0
"""Seconds for all tasks to end after the last kill."""


class Broken(Exception):
    """A failure of the robot that must not happen."""


class Life:
    """One life, with a given number of kills of central."""

    module_seconds = 6.0  #: between two faults of a module, on average

    def __init__(
        self, folder: Path, seed: int, kills: int, *, users: int = 2, events_between: int = 500
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.kills, self.users = folder, kills, users
        self.random = Random(seed)
        self.stops = [0.2, 1.0, 7.0]  #: seconds that a module may be stopped
        self.counts = Counter[str]()
        self.address = f"ipc://{folder}/c.sock"
        self._events_between = events_between
        self._seed = seed
        self._central: Process
        self._modules: dict[str, Process] = {}
        self._users: dict[str, Process] = {}
        self._resume: list[
            tuple[float, Process]
        ] = []  # stopped processes, with the time to continue
        self._processes: list[Process] = []  # all started processes
        self._doom: dict[str, float] = {}  # by module: the time of its next fault

    def run(self) -> None:
        """Run the life: kill, heal, end. Raise Broken if something fails that must not."""
        try:
            self._begin()
            while self.counts["kills of central"] < self.kills:
                self._central_dies()
            self._heal()
        finally:
            for process in self._processes:
                process.close()

    # --- chaos ------------------------------------------------------------------------------------

    def _begin(self) -> None:
        self._start_central()
        for name in MODULES:
            self._start_module(name)
        for number in range(self.users):
            self._start_user(f"user{number}")
        self._start_user("guest")

    def _start_central(self) -> None:
        log = self.folder / "central.log"
        self._logged = log.stat().st_size if log.exists() else 0
        self._central = self._start("central", "be_central", self._events_between)

    def _start(self, kind: str, function: str, *arguments: object) -> Process:
        """Start a process with a function of ``chaos.robot``. The process writes its output to the
        log of *kind*.
        """
        text = f"from pathlib import Path\nfrom chaos import robot\nrobot.{function}(*{arguments!r}, Path({str(self.folder)!r}))"
        process = Process(
            "-c", text, log=self.folder / f"{kind}.log", environment={"TCA_CENTRAL": self.address}
        )
        self._processes.append(process)
        return process

    def _start_module(self, name: str) -> None:
        self._modules[name] = self._start("module", "serve", name)
        self._doom[name] = time.monotonic() + self.random.expovariate(1 / self.module_seconds)

    def _start_user(self, name: str) -> None:
        self._users[name] = self._start("user", "use", name, self.random.getrandbits(32))

    def _central_dies(self) -> None:
        """Kill central once. Before this kill, central may be stopped for a while."""
        if self.random.random() < 0.2:  # while central starts
            self._pass(self.random.random() * 0.3)
        else:
            self._until_it_listens()
            self._pass(self.random.random() ** 2)
        if self.random.random() < 0.1:
            self._central.send_signal(signal.SIGSTOP)
            self._log("central stops")
            self._pass(self.random.random() * 2)
            self._central.send_signal(signal.SIGCONT)
            self._log("central continues")
            self.counts["stops of central"] += 1
            self._pass(self.random.random() * 0.3)
        self._check_central()
        self._central.close()
        self._log("central killed")
        self.counts["kills of central"] += 1
        if self.random.random() < 0.2:
            self._pass(self.random.random())
        self._start_central()

    def _check_central(self) -> None:
        if (status := self._central.poll()) is not None:
            raise Broken(f"central has ended with {status}; see {self.folder / 'central.log'}")

    def _until_it_listens(self) -> None:
        log = self.folder / "central.log"
        until = time.monotonic() + HEALED
        while True:
            if log.exists() and b"listening on" in log.read_bytes()[self._logged :]:
                self._log("central listens")
                return
            self._check_central()
            if time.monotonic() > until:
                raise Broken("central does not listen")
            self._pass(0.01)

    def _pass(self, seconds: float) -> None:
        """Let time pass. Modules are killed, stopped and continued in it."""
        until = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            self._do_due(now)
            if now >= until:
                return
            time.sleep(min(0.01, until - now))

    def _do_due(self, now: float) -> None:
        for due, process in [one for one in self._resume if one[0] <= now]:
            self._resume.remove((due, process))
            process.send_signal(signal.SIGCONT)
            self._log(f"process {process.pid} continues")
        for name in [name for name, due in self._doom.items() if due <= now]:
            self._meets_fate(name)

    def _meets_fate(self, name: str) -> None:
        process = self._modules[name]
        if (status := process.poll()) is not None:
            raise Broken(f"{name} has ended with {status}; see {self.folder / 'module.log'}")
        self._doom[name] = time.monotonic() + self.random.expovariate(1 / self.module_seconds)
        if self.random.random() < 0.4:
            process.send_signal(signal.SIGSTOP)
            self._resume.append((time.monotonic() + self.random.choice(self.stops), process))
            self.counts["stops of modules"] += 1
            self._log(f"process {process.pid}, {name}, stops")
            return
        process.close()
        self.counts["kills of modules"] += 1
        self._log(f"process {process.pid}, {name}, killed")
        self._start_module(name)
        if self.random.random() < 0.3:
            guest = self._users.pop("guest")
            guest.close()
            self.counts["kills of users"] += 1
            self._log(f"process {guest.pid}, guest, killed")
            self._start_user("guest")

    def _log(self, what: str) -> None:
        with (self.folder / "chronicle").open("a") as chronicle:
            print(time.strftime("%H:%M:%S"), f"{time.monotonic():.3f}", what, file=chronicle)

    # --- the end ----------------------------------------------------------------------------------

    def _heal(self) -> None:
        """End the kills. Then all tasks must end, and all users must be answered."""
        self._log("nothing more dies")
        self._doom.clear()
        while self._resume:
            self._pass(0.05)
        (self.folder / "over").touch()
        began = time.monotonic()
        until = began + HEALED
        while self._users:
            for name, process in list(self._users.items()):
                if (status := process.poll()) is not None:
                    del self._users[name]
                    if status:
                        raise Broken(f"{name} ended with {status}; see {self.folder / 'user.log'}")
            self._check_central()
            if self._users and time.monotonic() > until:
                raise Broken(f"{', '.join(self._users)} waits for an answer")
            time.sleep(0.02)
        with connect("judge", self.address, patience=20) as judge:
            while rest := judge.tasks():
                if time.monotonic() > until:
                    raise Broken(f"these tasks never end: {rest}")
                time.sleep(0.02)
        self.counts["ms to heal"] += round((time.monotonic() - began) * 1000)
        for name in list(self._modules):
            process = self._modules.pop(name)
            process.terminate()
            if status := process.wait():
                raise Broken(f"{name} ended with {status}; see {self.folder / 'module.log'}")
        self._end_central()

    def _end_central(self) -> None:
        self._central.terminate()
        if status := self._central.wait():
            raise Broken(f"central ended with {status}")
