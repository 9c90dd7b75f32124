"""The life of programs that exchange images. They and central are killed and stopped at random."""

import fcntl
import io
import re
import shutil
import signal
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import IO, Any

from chaos.images import MODULES
from processes import Process, tca

from tca_central.shell.recovery import recover, unfinished_segments
from tca_central.shell.store import Store
from tca_module import connect

HEALED = 120.0  # seconds for waits to end
CLIENTS = "talker", "client"
HOWS = "kill", "kill", "stop", "end"
MOST_FILES, MOST_MEMORY = 100, 300 << 20  # descriptors and bytes of private memory of a process
FAILURES = {"done", "module lost", "uncertain"}
FULL_FAILURES = {"overload", "handler error"}  # if memory is full
LOSS_FAILURES = {"bad data"}  # if memory is lost


class Life:
    """The processes of one life, and what is wrong with it."""

    def __init__(self, folder: Path, seed: int, size: int, *, loses_memory: bool) -> None:
        self.loses_memory = loses_memory
        self.folder, self.random, self.size = folder, Random(seed), size
        self.address = f"ipc://{folder}/c.sock"
        self.wrong: list[str] = []
        self.counts = Counter[str]()
        self.running: dict[str, Process] = {}
        self.processes: list[Process] = []  #: all that were started
        self.stopped: dict[str, float] = {}  #: by name: when the process continues
        self.store = folder / "store"  # central says which it is
        self.key: IO[Any] = io.StringIO()

    def run(self, faults: int) -> None:
        """Live, with a number of faults; then end everything, and check what is left."""
        try:
            for name in ("central", *MODULES, *CLIENTS):
                self.start(name)
            self.store = self.listening()
            self.key = (self.store / "key").open()  # no other central removes the folder
            fcntl.flock(self.key, fcntl.LOCK_SH)
            for _ in range(faults):
                self.wait(1.5 * self.random.random() ** 2)
                self.fault()
                self.measure()
            while self.stopped:
                self.wait(0.05)
            for name in CLIENTS:
                self.end(name)
            with connect("judge", self.address, patience=HEALED) as judge:
                self.until(lambda: not judge.tasks(), "tasks do not end")
            for name in MODULES:
                self.end(name)
            self.check_rest()
        finally:
            for process in self.processes:
                process.close()
            self.key.close()

    def start(self, name: str) -> None:
        """Start a program, or central."""
        seed = self.random.getrandbits(32)
        call = "be_central(" if name == "central" else f"run({name!r}, {self.size}, {seed}, "
        text = f"from chaos import images\nimages.{call}{str(self.folder)!r})"
        log = self.folder / f"{name}.log"
        process = Process("-c", text, log=log, environment={"TCA_CENTRAL": self.address})
        self.running[name] = process
        self.processes.append(process)

    def listening(self) -> Path:
        """Wait until central listens; return the folder of its shared memory."""
        with connect("judge", self.address, patience=HEALED) as judge:
            pool = judge._open_link().line.large._pool
            assert pool is not None
            return Path(pool.folder).parent

    def wait(self, seconds: float) -> None:
        """Let time pass, in which stopped processes continue."""
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            for name in [name for name, due in self.stopped.items() if due <= now]:
                del self.stopped[name]
                self.running[name].send_signal(signal.SIGCONT)
            for name, process in self.running.items():
                assert process.poll() is None, f"{name} has ended"
            time.sleep(0.01)

    def until(self, is_true: Callable[[], object], what: str) -> None:
        """Let time pass until something is true."""
        end = time.monotonic() + HEALED
        while not is_true():
            assert time.monotonic() < end, what
            self.wait(0.01)

    # --- faults -----------------------------------------------------------------------------------

    def fault(self) -> None:
        """Kill, stop or end a process that is not stopped."""
        names = [*MODULES, *CLIENTS, *["central"] * 3]
        name = self.random.choice([one for one in names if one not in self.stopped])
        how = self.random.choice(HOWS)
        if how == "end" and "central" in self.stopped:
            how = "kill"
        self.counts[f"{how} {name}"] += 1
        if how == "stop":
            self.running[name].send_signal(signal.SIGSTOP)
            self.stopped[name] = time.monotonic() + self.random.choice([0.2, 1.0, 7.0])
            return
        if how == "kill":
            self.running.pop(name).close()
            if name == "central" and self.loses_memory:
                shutil.rmtree(self.store, ignore_errors=True)
        else:
            self.end(name, signal.SIGUSR1 if name == "central" else signal.SIGTERM)
        self.start(name)

    def end(self, name: str, number: int = signal.SIGTERM) -> None:
        """End a process regularly. A program waits for what it has sent."""
        process = self.running[name]
        if name == "central":  # a younger one does not handle the signal yet
            self.listening()
        else:
            notes = self.folder / f"{name}.{process.pid}.notes"
            self.until(notes.exists, f"{name} does not begin")
        del self.running[name]
        process.send_signal(number)
        self.until(lambda: process.poll() is not None, f"{name} does not end")
        assert process.wait() == 0, name

    def measure(self) -> None:
        """Check what the living processes hold."""
        for name, process in self.running.items():
            files = len(list(Path(f"/proc/{process.pid}/fd").iterdir()))
            status = Path(f"/proc/{process.pid}/status").read_text()
            found = re.search(r"RssAnon:\s+(\d+) kB", status)
            memory = int(found[1]) << 10 if found else 0
            self.counts["most files"] = max(files, self.counts["most files"])
            self.counts["most MB"] = max(memory >> 20, self.counts["most MB"])
            if files > MOST_FILES or memory > MOST_MEMORY:
                self.wrong.append(f"{name} has {files} files open, and {memory:,} bytes")
        self.counts["most segments"] = max(len(self.segments()), self.counts["most segments"])

    # --- the end ----------------------------------------------------------------------------------

    def check_rest(self) -> None:
        """Restart central without programs, compare the segments with its state, and end it.

        It still has variables, and results of ended tasks.
        """
        self.running.pop("central").close()
        referred = self.referred()
        self.start("central")
        self.listening()
        self.until(lambda: self.segments() <= referred, "segments are left")
        self.running.pop("central").close()
        lost = self.referred() - self.segments()
        assert self.loses_memory or not lost, lost
        self.start("central")
        self.end("central")
        assert not self.store.exists()
        assert not (self.folder / "journal" / "held").exists()

    def segments(self) -> set[str]:
        """Return the names of all segments."""
        return {f"{path.parent.name}/{path.name}" for path in self.store.glob("*/*")}

    def referred(self) -> set[str]:
        """Return the names of the segments to which the state of the killed central refers."""
        copy, store = self.folder / "copy", Store()
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(self.folder / "journal", copy)
        run = recover(copy, unfinished_segments(copy), adopt=store.adopt)
        store.settle(run.central.registry.modules)
        return set(store._held)


class Judge:
    """The contradictions in the notebooks of all programs."""

    def __init__(self, folder: Path, failures: set[str]) -> None:
        self.wrong: list[str] = []
        self.counts = Counter[str]()
        self.begun, self.ended, self.done = Counter[str](), set[str](), set[str]()
        #: by receiver, message and sender: when which number was received
        self.heard = defaultdict[tuple[str, str, str], list[tuple[int, int]]](list)
        for path in folder.glob("*.notes"):
            self._read(path, failures)
        twice = [task for task, number in self.begun.items() if number > 1]
        if twice or not self.done <= self.ended:
            self.wrong.append(f"begun twice: {twice}; not carried out: {self.done - self.ended}")
        for (receiver, what, sender), found in self.heard.items():
            self.counts[what] += len(found)
            numbers = [number for _, number in sorted(found)]
            wrong = [pair for pair in pairwise(numbers) if pair[0] >= pair[1]]
            if wrong:
                self.wrong.append(f"{receiver} received {what}s of {sender} as {wrong[:5]}")

    def _read(self, path: Path, failures: set[str]) -> None:
        waits, is_over = set[str](), False
        for line in path.read_text().splitlines():
            at, word, *about = line.split("\t")
            if word == "heard":
                receiver = path.name.partition(".")[0]
                self.heard[receiver, about[0], about[1]].append((int(at), int(about[2])))
            elif word == "begin":
                self.begun[about[0]] += 1
            elif word == "end":
                self.ended.add(about[0])
            elif word == "awaits":
                waits.add(about[0])
            elif word == "outcome":
                number, task, what, outcome = about
                waits.discard(number)
                self.counts[f"{what} {outcome}"] += 1
                self.done |= {task} if (what, outcome) == ("task", "done") else set()
                if outcome not in failures:
                    self.wrong.append(f"{what} {number} of {path.name}: {outcome}")
            elif word == "wrong":
                self.wrong.append(f"{path.name}: {about}")
            is_over |= word == "over"
        if waits and is_over:
            self.wrong.append(f"{path.name} was not answered: {waits}")


def live(
    folder: str,
    seed: int,
    faults: int,
    size: int,
    *,
    has_full_memory: bool = False,
    loses_memory: bool = False,
) -> Counter[str]:
    """Live and judge; return the counts. With *loses_memory*, it is lost when central is killed."""
    life = Life(Path(folder), seed, size, loses_memory=loses_memory)
    life.run(faults)
    failures = FAILURES | (FULL_FAILURES if has_full_memory else set())
    judge = Judge(life.folder, failures | (LOSS_FAILURES if loses_memory else set()))
    wrong = life.wrong + judge.wrong
    assert not wrong, wrong
    checked = tca("check", f"{folder}/journal")
    assert checked.returncode == 0, checked.stdout
    return life.counts + judge.counts
