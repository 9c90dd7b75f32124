"""The checks of a life: the notebooks of the programs are compared with the journal of central."""

import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from chaos.robot import GRIP, NOTE, SEEN, STEP, WALK, WHERE

from tca_tools.journal.journals import open_log
from tca_wire.journal import facts


class Note(NamedTuple):
    """A line of a notebook."""

    time: int
    word: str
    about: list[str]


class Judge:
    """The contradictions between the notebooks and the journal."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.counts = Counter[str]()
        self.wrong: list[str] = []
        self.notebooks = {path.stem: list(_notes(path)) for path in sorted(folder.glob("*.notes"))}
        self.received: dict[int, facts.Received] = {}
        self.task_of: dict[int, int] = {}  #: by delivery
        self.retries = Counter[int]()
        self.failed: dict[int, str] = {}  #: by delivery or message
        self._read_journal()
        self._executions()
        self._users()
        self._informs()
        self._locks()
        self._rules()

    def _read_journal(self) -> None:
        for entry in open_log(self.folder / "journal"):
            for fact in entry.facts:
                match fact:
                    case facts.Received():
                        self.received[fact.id] = fact
                        self.counts["tasks"] += fact.message_class.is_task
                    case facts.Delivered():
                        self.task_of[fact.id] = fact.message_id
                    case facts.Retried():
                        self.retries[fact.task] += 1
                        self.counts["retried"] += 1
                    case facts.Failed():
                        self.failed[fact.id] = fact.failure
                        self.counts[fact.failure] += 1
                    case facts.CentralRestarted():
                        self.counts["restarts"] += 1
                        self.counts["ms away"] += round(fact.away * 1000)
                    case facts.ModuleLeft(lost=True):
                        self.counts["programs lost"] += 1
                    case _:
                        pass
        self.counts["entries"] = entry.number

    def _executions(self) -> None:
        """Check that no handler starts twice without a retry, and that a handler has ended each
        task that is done.
        """
        begun, ended, times = Counter[int](), defaultdict[int, list[str]](list), Counter[int]()
        for notes in self.notebooks.values():
            for note in notes:
                if note.word == "begin":
                    begun[int(note.about[0])] += 1
                    times[int(note.about[1])] += note.about[2] in (STEP.name, GRIP.name, WALK.name)
                if note.word == "end":
                    ended[int(note.about[1])].append(note.about[2])
        self.counts["handlers begun"] = begun.total()
        self.wrong += [
            f"delivery {number} was begun {count} times"
            for number, count in begun.items()
            if count > 1
        ]
        self.wrong += [
            f"task {number} was begun {count} times, and retried {self.retries[number]} times"
            for number, count in times.items()
            if number and count > 1 + self.retries[number]
        ]
        for notes in self.notebooks.values():
            for note in notes:
                if note.word == "done" and not ended[int(note.about[1])]:
                    self.wrong.append(f"task {note.about[1]} is done, but no handler has ended it")

    def _users(self) -> None:
        """Check that each accepted task is in the journal, and that each wait was answered."""
        for name, notes in self.notebooks.items():
            waits = set[str]()
            for note in notes:
                if note.word in ("awaits", "asks"):
                    waits.add(note.about[0])
                elif note.word in ("done", "failed", "answered", "unanswered", "cut off"):
                    waits.discard(note.about[0])
                    what = note.about[-1] if note.word in ("failed", "unanswered") else ""
                    self.counts[f"users: {note.word} {what}".strip()] += 1
                if (
                    note.word in ("taken", "done", "failed")
                    and int(note.about[1]) not in self.received
                ):
                    self.wrong.append(
                        f"task {note.about[1]} of {name} was accepted, but is not in the journal"
                    )
            if waits and any(note.word == "over" for note in notes):
                self.wrong.append(f"{name} was not answered: {waits}")

    def _informs(self) -> None:
        """Check that no inform is handled twice. A surviving sender must have counted at least as
        many lost informs as there are.
        """
        noted = Counter(
            note.about[0]
            for notes in self.notebooks.values()
            for note in notes
            if note.word == "noted"
        )
        known = Counter(
            NOTE.data.decode(one.body)
            for one in self.received.values()
            if one.message == NOTE.name and one.body
        )
        self.wrong += [
            f"inform {name} was handled {count} times" for name, count in noted.items() if count > 1
        ]
        for name, notes in self.notebooks.items():
            told = [note.about[0] for note in notes if note.word == "told"]
            self.counts["informs"] += len(told)
            self.counts["informs handled"] += sum(noted[one] for one in told)
            if any(note.word == "over" for note in notes):
                self.wrong += [
                    f"inform {one} of {name} came {known[one]} times"
                    for one in told
                    if known[one] > 1
                ]
                lost = sum(not known[one] for one in told)
                admitted = sum(int(note.about[0]) for note in notes if note.word == "not sent")
                self.counts.update({"informs lost": lost, "informs told to be lost": admitted})
                if lost > admitted:
                    self.wrong.append(
                        f"{lost} informs of {name} never came, but it knows of {admitted}"
                    )

    def _locks(self) -> None:
        """Check that no handler runs in a locked resource."""
        spans = list[tuple[int, int, str]]()
        for notes in self.notebooks.values():
            kept = {note.about[0] for note in notes if note.word == "released"}
            begun = dict[str, int]()
            for note in notes:
                if note.word == "locked":
                    begun[note.about[0]] = note.time
                elif note.word == "unlocked" and note.about[0] in kept:
                    spans.append((begun[note.about[0]], note.time, f"lock of {note.about[0]}"))
                elif note.word == "begin" and note.about[2] in (WHERE.name, SEEN.name):
                    begun[note.about[0]] = note.time
                elif (
                    note.word == "end"
                    and note.about[0] in begun
                    and int(note.about[0]) not in self.failed
                ):
                    spans.append((begun[note.about[0]], note.time, f"delivery {note.about[0]}"))
        spans.sort()
        self.counts["locks and looks"] = len(spans)
        for (_, end, one), (begin, _, other) in pairwise(spans):
            if begin < end and "lock" in one + other:
                self.wrong.append(f"{one} and {other} overlap by {(end - begin) / 1e6:.1f} ms")

    def _rules(self) -> None:
        tca = Path(sys.executable).with_name("tca")
        checked = subprocess.run(
            [tca, "check", self.folder / "journal"], capture_output=True, text=True, check=False
        )
        if checked.returncode:
            self.wrong.append(f"tca check: {checked.stdout[-2000:]}{checked.stderr[-500:]}")


def _notes(path: Path) -> Iterator[Note]:
    for line in path.read_text().splitlines():
        time, word, *about = line.split("\t")
        yield Note(int(time), word, about)
