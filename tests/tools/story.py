"""Builders of journals. A story adds, event by event, the facts that central would write."""

import fcntl
import json
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, get_args

import msgspec
from central.transcript_words import constraints, read_fields

from tca_tools.journal.fold import History
from tca_wire.constraints import Constraint, delay_planning, sequential_achievement
from tca_wire.journal import facts
from tca_wire.journal.causes import Request
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import record
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

GOAL, COMMAND, QUERY = MessageClass.GOAL, MessageClass.COMMAND, MessageClass.QUERY
PLANNING = Moment.START_HANDLING | Moment.START_PLANNING
ACTING = Moment.START_HANDLING | Moment.START_ACHIEVING
BORN_PLANNED = Moment.START_PLANNING | Moment.END_PLANNING


@contextmanager
def silent_for(run: Path, seconds: float) -> Iterator[None]:
    """Hold a journal open, as a live central does. Its last write was *seconds* ago."""
    segment = run / "00000001.tcaj"
    os.utime(segment, (time.time() - seconds,) * 2)
    with segment.open("ab") as central:
        fcntl.flock(central, fcntl.LOCK_EX)
        yield


class Story:
    """A journal in the making. ``at`` begins an event at a time; each other method adds facts to
    this event.
    """

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._next_id = 1
        self._places: dict[int, tuple[str, str]] = {}
        self._classes: dict[int, MessageClass] = {}
        self.at(0.0)
        self.say(facts.Opened(JOURNAL_VERSION, "epoch", 1, 1_700_000_000.0, "0.1.0"))

    def at(self, time: float) -> "Story":
        self.entries.append(Entry(len(self.entries) + 1, time, []))
        return self

    def asked_by(self, delivery: int) -> "Story":
        """Note that a handler caused the current event."""
        entry = self.entries[-1]
        self.entries[-1] = Entry(
            entry.number, entry.time, entry.facts, Request("any", 1, 1, "Kill", delivery)
        )
        return self

    def fold(self, until: float | None = None) -> History:
        return History.until(self.caused(), until)

    def caused(self) -> list[Entry]:
        """Return the entries. An entry without a cause gets the cause that its facts imply."""
        claims: dict[int, facts.Claimed] = {}
        return [
            entry if entry.cause else msgspec.structs.replace(entry, cause=_cause(entry, claims))
            for entry in self.entries
        ]

    def say(self, *added: Any) -> "Story":
        self.entries[-1].facts.extend(added)
        return self

    def module(self, name: str, *handles: str, resource: str = "") -> "Story":
        self.say(facts.ModuleJoined(name, f"pid {len(name)}"))
        if handles:
            self.say(facts.ResourceChanged(name, resource or name, 1))
        return self.say(
            *(facts.HandlerAdded(message, name, resource or name) for message in handles)
        )

    def received(
        self,
        message: str,
        kind: MessageClass,
        sender: str,
        parent: int = 0,
        *constraints: Constraint,
        origin: int | None = None,
        data: Any = None,
        blocking: bool = False,
        role: Role = Role.NONE,
        about: int = 0,
        to: str = "",
        begins: bool = False,
    ) -> int:
        """Add a message. *to* delivers it to a module; *begins* also starts its achieving."""
        number, self._next_id = self._next_id, self._next_id + 1
        this = [
            msgspec.structs.replace(
                c, before=_resolved(c.before, number), after=_resolved(c.after, number)
            )
            for c in constraints
        ]
        body = b"" if data is None else msgspec.msgpack.encode(data)
        origin = parent if origin is None else origin
        self._classes[number] = kind
        self.say(
            facts.Received(
                number,
                message,
                kind,
                sender,
                TaskId(parent),
                origin,
                blocking,
                body,
                this,
                role,
                about,
            )
        )
        if kind is COMMAND:
            self.reached(number, BORN_PLANNED)
        if to:
            self.delivered(number, to)
        if begins:
            self.reached(number, Moment.START_ACHIEVING)
        return number

    def goal(
        self, message: str, sender: str, parent: int = 0, *constraints: Constraint, **more: Any
    ) -> int:
        return self.received(message, GOAL, sender, parent, *constraints, **more)

    def command(
        self, message: str, sender: str, parent: int = 0, *constraints: Constraint, **more: Any
    ) -> int:
        return self.received(message, COMMAND, sender, parent, *constraints, **more)

    def queued(self, number: int, module: str = "", resource: str = "") -> "Story":
        return self.say(facts.Queued(number, number, module, resource or module))

    def delivered(self, number: int, module: str, resource: str = "") -> "Story":
        self.say(facts.Delivered(number, number, module, resource or module))
        kind = self._classes[number]
        if kind.is_task:
            self.reached(number, PLANNING if kind is GOAL else ACTING)
        return self

    def returned(self, number: int, outcome: Outcome = Outcome.DONE, data: Any = None) -> "Story":
        self.say(
            facts.Returned(number, outcome, b"" if data is None else msgspec.msgpack.encode(data))
        )
        if self._classes[number].is_task:
            self.reached(number, Moment.END_HANDLING)
        return self

    def achieved(self, number: int) -> "Story":
        return self.returned(number).reached(number, Moment.END_ACHIEVING)

    def failed(self, number: int, failure: str, text: str = "") -> "Story":
        return self.returned(number, Outcome.FAILED).say(facts.Failed(number, failure, text))

    def rescued(self, failed: int, name: str, module: str) -> int:
        """Start an exception handler of a module for a failure."""
        handler = self.received(
            name,
            MessageClass.EXCEPTION,
            "central",
            failed,
            origin=0,
            role=Role.EXCEPTION,
            about=failed,
        )
        self.say(facts.Caught(TaskId(failed), TaskId(handler), TaskId(failed), 9)).delivered(
            handler, module
        )
        self.reached(handler, Moment.START_PLANNING)
        return handler

    def reached(self, number: int, *moments: Moment) -> "Story":
        bits = 0
        for moment in moments:
            bits |= moment
        return self.say(facts.Reached(TaskId(number), bits))

    def query(
        self, message: str, sender: str, origin: int, module: str, took: float, **more: Any
    ) -> int:
        """Add a query that takes *took* seconds. Afterwards the clock stands at the answer."""
        time = self.entries[-1].time
        number = self.received(message, QUERY, sender, 0, origin=origin, blocking=True, **more)
        self.delivered(number, module)
        self.at(round(time + took, 6)).returned(number, data={"ok": True}).say(
            facts.Answered(number)
        )
        return number

    def acted(self, number: int, module: str, took: float) -> "Story":
        """Deliver a command, and achieve it *took* seconds later."""
        time = self.entries[-1].time
        self.delivered(number, module)
        return self.at(round(time + took, 6)).achieved(number)

    def encoded(self) -> bytes:
        return b"".join(map(record, self.caused()))

    def write(self, folder: Path, segments: int = 1) -> Path:
        """Write the journal as a folder, with its entries spread over *segments* files."""
        folder.mkdir(parents=True)
        entries_with_causes = self.caused()
        size = -(-len(entries_with_causes) // segments)
        for number in range(segments):
            entries = entries_with_causes[number * size : (number + 1) * size]
            if number:
                entries = [
                    Entry(
                        0,
                        entries[0].time,
                        [
                            facts.Opened(
                                JOURNAL_VERSION, "epoch", number + 1, 1_700_000_000.0, "0.1.0"
                            )
                        ],
                    ),
                    *entries,
                ]
            (folder / f"{number + 1:08d}.tcaj").write_bytes(b"".join(map(record, entries)))
        return folder


def _cause(entry: Entry, claims: dict[int, facts.Claimed]) -> Request | None:
    """Return the implied request: the reply of a handler, or the first send, lock or unlock."""
    sent: Request | None = None
    for fact in entry.facts:
        match fact:
            case facts.Returned():
                return Request("any", 1, 1, "Reply", fact.id)
            case facts.Received() if not fact.role:
                sent = sent or Request(fact.sender, 0, 1, "Send", fact.origin)
            case facts.Claimed():
                claims[fact.id] = fact
                sent = sent or Request(fact.sender, 0, 1, "Lock", fact.origin)
            case facts.ClaimEnded() if fact.id in claims:
                sent = sent or Request(
                    claims[fact.id].sender, 0, 1, "Unlock", claims[fact.id].origin
                )
    return sent


def _resolved(point: Any, number: int) -> Any:
    return msgspec.structs.replace(point, task=TaskId(number)) if point.task == -1 else point


THIS = TaskId(-1)


# --- stories in files -----------------------------------------------------------------------------


MADE = Path(__file__).with_name("made")
KINDS = {one.__struct_config__.tag: one for one in get_args(facts.Fact)}
CLASSES = "|".join(sorted(MessageClass, key=len, reverse=True))


def apply_line(story: Story, line: str) -> bool:
    """Add the facts of one line. False if the line is not of a story.

    These are the forms of a line, with optional parts in brackets.

    - ``see made/NAME``: all lines of that file.
    - ``at TIME``: the next event.
    - ``MODULE joins[, and handles MESSAGE, ...][ in RESOURCE]``.
    - ``CLASS MESSAGE {ID} from SENDER[ under TASK][ in DELIVERY][ and waits][ as ROLE of ID]
      [ to MODULE[, and begins]][ with JSON][ where POINT <= POINT, ...]``.
    - ``queued ID[ for MODULE[ / RESOURCE]]``.
    - ``delivered ID to MODULE[ / RESOURCE]``.
    - ``returned ID[: OUTCOME][ with JSON]``.
    - ``failed ID: FAILURE[: TEXT]``.
    - ``achieved ID``.
    - ``reached ID: MOMENT, ...``, or ``reached ID: all``.
    - ``asked by DELIVERY``.
    - ``KIND FIELD=JSON ...``: any other fact.
    """
    for pattern, do in LINE_PATTERNS:
        if found := re.fullmatch(pattern, line):
            do(
                story,
                **{name: text for name, text in found.groupdict().items() if text is not None},
            )
            return True
    kind = max((one for one in KINDS if line.startswith(f"{one} ")), key=len, default="")
    if not kind:
        return False
    story.say(KINDS[kind](**read_fields(KINDS[kind], line.removeprefix(kind))))
    return True


def apply_made(story: Story, name: str) -> None:
    for line in (MADE / f"{name}.txt").read_text().splitlines():
        assert line.startswith("#") or apply_line(story, line), line


def joins(story: Story, name: str, handles: str = "", resource: str = "") -> None:
    story.module(name, *filter(None, handles.split(", ")), resource=resource)


def received(story: Story, kind: str, message: str, number: str, sender: str, **more: str) -> None:
    assigned = story.received(
        message,
        MessageClass(kind),
        sender,
        int(more.get("parent", 0)),
        *constraints(more["where"]) if "where" in more else (),
        origin=int(more["origin"]) if "origin" in more else None,
        blocking="blocking" in more,
        data=json.loads(more["data"]) if "data" in more else None,
        role=Role(more.get("role", "")),
        about=int(more.get("about", 0)),
        to=more.get("to", ""),
        begins="begins" in more,
    )
    assert assigned == int(number), f"that is {assigned}"


def returned(story: Story, number: str, outcome: str = "done", data: str = "null") -> None:
    story.returned(int(number), Outcome(outcome), json.loads(data))


def reached(story: Story, number: str, moments: str) -> None:
    story.reached(int(number), *(Moment if moments == "all" else map(moment, moments.split(", "))))


def moment(words: str) -> Moment:
    return Moment[words.upper().replace(" ", "_")]


PLACE = r"(?P<module>.+?)(?: / (?P<resource>.+))?"
JSON = r"(?: with (?P<data>[\[{\"\d-].*?))?"
RECEIVED = (
    rf"(?P<kind>{CLASSES}) (?P<message>.+?) \{{(?P<number>\d+)\}} from (?P<sender>.+?)(?: under (?P<parent>\d+))?"
    r"(?: in (?P<origin>\d+))?(?P<blocking> and waits)?(?: as (?P<role>[a-z ]+) of (?P<about>\d+))?"
    rf"(?: to (?P<to>.+?)(?P<begins>, and begins)?)?{JSON}(?: where (?P<where>.+))?"
)
LINE_PATTERNS: list[tuple[str, Callable[..., object]]] = [
    (r"see made/(?P<name>\w+)", apply_made),
    (r"at (?P<time>[\d.]+)", lambda story, time: story.at(float(time))),
    (r"(?P<name>.+?) joins(?:, and handles (?P<handles>.+?))?(?: in (?P<resource>.+))?", joins),
    (RECEIVED, received),
    (
        rf"queued (?P<number>\d+)(?: for {PLACE})?",
        lambda story, number, **where: story.queued(int(number), **where),
    ),
    (
        rf"delivered (?P<number>\d+) to {PLACE}",
        lambda story, number, **where: story.delivered(int(number), **where),
    ),
    (rf"returned (?P<number>\d+)(?:: (?P<outcome>[a-z]+))?{JSON}", returned),
    (
        r"failed (?P<number>\d+): (?P<failure>.+?)(?:: (?P<text>.*))?",
        lambda story, number, **how: story.failed(int(number), **how),
    ),
    (r"achieved (?P<number>\d+)", lambda story, number: story.achieved(int(number))),
    (r"reached (?P<number>\d+): (?P<moments>.+)", reached),
    (r"asked by (?P<number>\d+)", lambda story, number: story.asked_by(int(number))),
]


def made(*names: str) -> Story:
    """Return the story with this name in made/. Several names are played one after the other."""
    story = Story()
    for name in names:
        apply_made(story, name)
    return story


walking = partial(made, "walking")
stumbling = partial(made, "walking", "stumbling")
arcs = partial(made, "arcs")
locking = partial(made, "locking")


def stuck(drills: int = 4) -> Story:
    """Return a story of drills in sequence. The handler of the first drill waits for a calibration,
    which has no handler.
    """
    story = Story().module("brain", "mission").module("rig", "drill").at(1.0)
    mission = story.goal("mission", "user", to="brain", begins=True)
    drill = story.command("drill", "brain", mission, to="rig", begins=True)
    calibrate = story.at(2.0).command("calibrate", "rig", drill)
    story.queued(calibrate).say(
        facts.WaitBegan("rig", drill, TaskId(calibrate), Moment.END_ACHIEVING)
    )
    for _ in range(drills - 1):
        drill = story.command(
            "drill", "brain", mission, sequential_achievement(TaskId(max(drill, 2)), THIS)
        )
    return story.returned(mission).at(5.0)


def stepping(steps: int = 3) -> Story:
    """Return a story of a robot that plans each step for 1 s and moves for 2 s, without planning
    ahead.

    The walk is sent at 1.0, its steps at 1.2. Planning and acting alternate from 1.3 on.
    """
    story = (
        Story().module("user").module("planner", "walk", "step", "errand").module("legs", "move")
    )
    walk = story.at(1.0).goal("walk", "user", to="planner", begins=True)
    story.at(1.2)
    before: list[Constraint] = []
    sent = []
    for _ in range(steps):
        sent.append(story.goal("step", "planner", walk, *before))
        before = [sequential_achievement(TaskId(sent[-1]), THIS), delay_planning(THIS)]
    story.queued(sent[0], "planner").at(1.3).returned(walk)
    for number, step in enumerate(sent):
        now = round(2.3 + 3.0 * number, 6)
        story.delivered(step, "planner").reached(step, Moment.START_ACHIEVING)
        move = story.at(now).command("move", "planner", step, to="legs")
        story.at(now).returned(step).reached(step, Moment.END_PLANNING)
        story.at(round(now + 2.0, 6)).achieved(move).reached(step, Moment.END_ACHIEVING)
    return story.reached(walk, Moment.END_PLANNING, Moment.END_ACHIEVING)
