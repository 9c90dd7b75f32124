"""Builders of journals: a story is told event by event, with the facts that central would write."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from tca_tools.journal.fold import History
from tca_wire.constraints import Constraint, delay_planning, plan_ahead, sequential_achievement
from tca_wire.journal import facts
from tca_wire.journal.causes import Request
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import record
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

GOAL, COMMAND, QUERY = MessageClass.GOAL, MessageClass.COMMAND, MessageClass.QUERY
PLANNING = Moment.START_HANDLING | Moment.START_PLANNING
ACTING = Moment.START_HANDLING | Moment.START_ACHIEVING
BORN_PLANNED = Moment.START_PLANNING | Moment.END_PLANNING


@contextmanager
def silent_for(run: Path, seconds: float) -> Iterator[None]:
    """Somebody has the journal open, as a central has, and wrote to it last so many seconds ago."""
    segment = run / "00000001.tcaj"
    os.utime(segment, (time.time() - seconds,) * 2)
    with segment.open("ab") as central:
        fcntl.flock(central, fcntl.LOCK_EX)
        yield


class Story:
    """A journal being told: ``at`` moves the clock, every other method adds facts to the event of that time."""

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
        """What is told next of this event, a handler has asked for."""
        entry = self.entries[-1]
        self.entries[-1] = Entry(entry.number, entry.time, entry.facts, Request("any", 1, 1, "Kill", delivery))
        return self

    def fold(self, until: float | None = None) -> History:
        return History.until(self.caused(), until)

    def caused(self) -> list[Entry]:
        """Its entries, each with the cause that its facts tell of, where none was told."""
        claims: dict[int, facts.Claimed] = {}
        return [
            entry if entry.cause else msgspec.structs.replace(entry, cause=_cause(entry, claims))
            for entry in self.entries
        ]

    def say(self, *said: Any) -> "Story":
        self.entries[-1].facts.extend(said)
        return self

    def module(self, name: str, *handles: str, resource: str = "") -> "Story":
        self.say(facts.ModuleJoined(name, f"pid {len(name)}"))
        if handles:
            self.say(facts.ResourceChanged(name, resource or name, 1))
        return self.say(*(facts.HandlerAdded(message, name, resource or name) for message in handles))

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
        """It may be delivered *to* a module at once, and begin to be achieved."""
        number, self._next_id = self._next_id, self._next_id + 1
        this = [
            msgspec.structs.replace(c, before=_resolved(c.before, number), after=_resolved(c.after, number))
            for c in constraints
        ]
        body = b"" if data is None else msgspec.msgpack.encode(data)
        origin = parent if origin is None else origin
        self._classes[number] = kind
        self.say(
            facts.Received(number, message, kind, sender, TaskId(parent), origin, blocking, body, this, role, about)
        )
        if kind is COMMAND:
            self.reached(number, BORN_PLANNED)
        if to:
            self.delivered(number, to)
        if begins:
            self.reached(number, Moment.START_ACHIEVING)
        return number

    def goal(self, message: str, sender: str, parent: int = 0, *constraints: Constraint, **more: Any) -> int:
        return self.received(message, GOAL, sender, parent, *constraints, **more)

    def command(self, message: str, sender: str, parent: int = 0, *constraints: Constraint, **more: Any) -> int:
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
        self.say(facts.Returned(number, outcome, b"" if data is None else msgspec.msgpack.encode(data)))
        if self._classes[number].is_task:
            self.reached(number, Moment.END_HANDLING)
        return self

    def achieved(self, number: int) -> "Story":
        return self.returned(number).reached(number, Moment.END_ACHIEVING)

    def failed(self, number: int, failure: str, text: str = "") -> "Story":
        return self.returned(number, Outcome.FAILED).say(facts.Failed(number, failure, text))

    def rescued(self, failed: int, name: str, module: str) -> int:
        """An exception handler of that module is called for a failure, and runs."""
        handler = self.received(
            name, MessageClass.EXCEPTION, "central", failed, origin=0, role=Role.EXCEPTION, about=failed
        )
        self.say(facts.Caught(TaskId(failed), TaskId(handler), TaskId(failed), 9)).delivered(handler, module)
        self.reached(handler, Moment.START_PLANNING)
        return handler

    def reached(self, number: int, *moments: Moment) -> "Story":
        bits = 0
        for moment in moments:
            bits |= moment
        return self.say(facts.Reached(TaskId(number), bits))

    def query(self, message: str, sender: str, origin: int, module: str, took: float, **more: Any) -> int:
        """A query that is answered after a while; the clock stands at the answer then."""
        time = self.entries[-1].time
        number = self.received(message, QUERY, sender, 0, origin=origin, blocking=True, **more)
        self.delivered(number, module)
        self.at(round(time + took, 6)).returned(number, data={"ok": True}).say(facts.Answered(number))
        return number

    def acted(self, number: int, module: str, took: float) -> "Story":
        """A command that is handled and achieved in one go."""
        time = self.entries[-1].time
        self.delivered(number, module)
        return self.at(round(time + took, 6)).achieved(number)

    def encoded(self) -> bytes:
        return b"".join(map(record, self.caused()))

    def write(self, folder: Path, segments: int = 1) -> Path:
        """The journal as a directory, its entries spread over so many segments."""
        folder.mkdir(parents=True)
        told = self.caused()
        size = -(-len(told) // segments)
        for number in range(segments):
            entries = told[number * size : (number + 1) * size]
            if number:
                entries = [
                    Entry(
                        0,
                        entries[0].time,
                        [facts.Opened(JOURNAL_VERSION, "epoch", number + 1, 1_700_000_000.0, "0.1.0")],
                    ),
                    *entries,
                ]
            (folder / f"{number + 1:08d}.tcaj").write_bytes(b"".join(map(record, entries)))
        return folder


def _cause(entry: Entry, claims: dict[int, facts.Claimed]) -> Request | None:
    """Who must have asked for it: the handler that returned, or whoever sent or locked something."""
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
                sent = sent or Request(claims[fact.id].sender, 0, 1, "Unlock", claims[fact.id].origin)
    return sent


def _resolved(point: Any, number: int) -> Any:
    return msgspec.structs.replace(point, task=TaskId(number)) if point.task == -1 else point


THIS = TaskId(-1)


def walking() -> Story:
    """The Ambler traverses an arc (Simmons 1994, figure 2): its first step {2} is being taken, the second {3} has been
    planned meanwhile, the third {4} must not be planned before the second is taken."""
    story = Story().module("user interface")
    story.at(0.1).module("gait planner", "traverse arc", "take steps").module("perception", "elevation map")
    story.at(0.2).module("controller", "move leg", "move body")
    arc = story.at(0.5).goal(
        "traverse arc", "user interface", data={"radius": 5.0, "angle": 0.6}, to="gait planner", begins=True
    )
    story.say(facts.WaitBegan("user interface", 0, TaskId(arc), Moment.END_ACHIEVING))
    first = story.at(0.6).goal("take steps", "gait planner", arc, data={"from": 0})
    second = story.goal("take steps", "gait planner", arc, sequential_achievement(TaskId(first), THIS))
    story.goal(
        "take steps",
        "gait planner",
        arc,
        sequential_achievement(TaskId(second), THIS),
        plan_ahead(TaskId(second), THIS),
    )
    story.queued(first, "gait planner").queued(second, "gait planner")
    story.at(0.7).returned(arc).delivered(first, "gait planner").reached(first, Moment.START_ACHIEVING)
    leg, body = plan_step(story, first, until=1.4)
    story.delivered(leg, "controller").delivered(second, "gait planner")
    plan_step(story, second, until=2.2)
    story.at(3.4).returned(leg, data={"contact": [1.0, 2.0, -0.25]}).reached(leg, Moment.END_ACHIEVING)
    return story.delivered(body, "controller").at(4.0)


def plan_step(story: Story, step: int, until: float) -> tuple[int, int]:
    """The gait planner plans a step: asks for a map, then sends a leg and a body move in sequence."""
    now = story.entries[-1].time
    story.at(round(now + 0.1, 6)).query(
        "elevation map", "gait planner", step, "perception", took=round((until - now) * 0.6, 6)
    )
    leg = story.at(until).command("move leg", "gait planner", step, data={"leg": step, "height": 0.3})
    body = story.command("move body", "gait planner", step, sequential_achievement(TaskId(leg), THIS))
    story.returned(step).reached(step, Moment.END_PLANNING)
    return leg, body


def stumbling() -> Story:
    """The walk goes on: the body move of the first step fails, nobody handles that, and the arc is killed."""
    story = walking()
    story.at(4.5).returned(7, Outcome.FAILED, data={"force": 812.0}).say(
        facts.Failed(7, "terrain collision", "leg 4 met\x1b[31m rock")
    )
    for task in (1, 2, 3, 4, 9, 10):
        story.say(
            facts.Killed(TaskId(task), "failure 'terrain collision' of move body {7} was not handled", failed=TaskId(7))
        )
    for task in (7, 9, 10, 2, 3, 4, 1):
        story.reached(task, *Moment)
    return story.say(facts.WaitEnded("user interface", 0, TaskId(1))).at(5.0).say(facts.Closed("interrupted"))


def arcs() -> Story:
    """Arcs in sequence, each planned only when the one before has been traversed; none is handled yet."""
    story = Story().at(1.0)
    walk = story.goal("walk", "user interface", to="planner", begins=True)
    before: list[Constraint] = []
    for _ in range(3):
        arc = TaskId(story.goal("traverse arc", "planner", walk, *before))
        before = [sequential_achievement(arc, THIS), delay_planning(THIS)]
    return story.returned(walk)


def locking() -> Story:
    """While eyes looks, it locks the legs: a move queues; another is suspended, and handled when the planner has
    reserved the legs.
    """
    story = Story().module("planner", "walk").module("legs", "move", "adjust").module("eyes", "look").at(0.5)
    walk = story.goal("walk", "user", to="planner", begins=True)
    first, look = story.command("move", "planner", walk), story.command("look", "planner", walk)
    story.delivered(first, "legs").at(0.8).delivered(look, "eyes")
    story.at(1.0).say(facts.Claimed(90, "legs", "legs", False, "eyes", look))
    second, adjust = story.command("move", "planner", walk), story.command("adjust", "planner", walk)
    story.queued(second, "legs").say(facts.SuspendedOrResumed(TaskId(adjust), True))
    story.at(2.0).achieved(first).say(facts.Granted(90))
    story.at(3.0).say(facts.ClaimEnded(90, "released")).delivered(second, "legs").at(3.2).achieved(look)
    story.at(3.5).say(
        facts.SuspendedOrResumed(TaskId(adjust), False), facts.Claimed(91, "legs", "legs", True, "planner", walk)
    )
    story.at(4.0).achieved(second).say(facts.Granted(91)).delivered(adjust, "legs")
    return story.at(5.0).say(facts.Closed("interrupted"))


def mopping(by: str = "") -> Story:
    """A floor {1} is mopped in three sweeps, and suspended (*by* a module) during the first {2}, which runs on; then
    resumed. A drone {5} is wanted all the time, and nobody handles it.
    """
    story = Story().module("chef", "mop floor").module("broom", "sweep").at(1.0)
    mop = story.goal("mop floor", "user", to="chef", begins=True)
    sweep = story.command("sweep", "chef", mop, to="broom")
    story.command("sweep", "chef", mop, sequential_achievement(TaskId(sweep), THIS))
    story.command("sweep", "chef", mop, sequential_achievement(TaskId(sweep + 1), THIS))
    story.at(1.5).returned(mop).reached(mop, Moment.END_PLANNING).at(1.6).queued(story.command("fly", "user"))
    story.at(2.0).say(facts.SuspendedOrResumed(TaskId(mop), True, by)).at(3.0).achieved(sweep)
    story.at(9.0).say(facts.SuspendedOrResumed(TaskId(mop), False, by))
    story.acted(sweep + 1, "broom", 1.0).acted(sweep + 2, "broom", 1.0).reached(mop, Moment.END_ACHIEVING)
    return story.at(12.0).say(facts.Closed("interrupted"))


def resumed_alone() -> Story:
    """A walk {1} is suspended before its moves begin. The first one {2} is resumed alone, and runs on when the walk is
    suspended once more; the second one {3} begins when the walk is resumed.
    """
    story = Story().module("a", "walk").module("legs", "move").at(1.0)
    walk = story.goal("walk", "user", to="a", begins=True)
    first, second = story.command("move", "a", walk), story.command("move", "a", walk)
    story.at(2.0).returned(walk).say(facts.SuspendedOrResumed(TaskId(walk), True, "panel"))
    story.at(4.0).say(facts.SuspendedOrResumed(TaskId(first), False)).delivered(first, "legs")
    story.at(5.0).say(facts.SuspendedOrResumed(TaskId(walk), True, "panel")).at(6.0).achieved(first)
    story.at(9.0).say(facts.SuspendedOrResumed(TaskId(walk), False)).acted(second, "legs", 1.0)
    return story.reached(walk, Moment.END_ACHIEVING)


def ordered() -> Story:
    """A move {2} is created suspended by the planner, and resumed a second later."""
    story = Story().module("planner", "walk").module("legs", "move").at(1.0)
    walk = story.goal("walk", "user", to="planner", begins=True)
    move = story.at(2.0).command("move", "planner", walk)
    story.say(facts.SuspendedOrResumed(TaskId(move), True, "planner"))
    return story.at(3.0).say(facts.SuspendedOrResumed(TaskId(move), False, "planner")).delivered(move, "legs")


def stuck(drills: int = 4) -> Story:
    """Drills one after the other; the handler of the first one waits for a calibration that nobody handles."""
    story = Story().module("brain", "mission").module("rig", "drill").at(1.0)
    mission = story.goal("mission", "user", to="brain", begins=True)
    drill = story.command("drill", "brain", mission, to="rig", begins=True)
    calibrate = story.at(2.0).command("calibrate", "rig", drill)
    story.queued(calibrate).say(facts.WaitBegan("rig", drill, TaskId(calibrate), Moment.END_ACHIEVING))
    for _ in range(drills - 1):
        drill = story.command("drill", "brain", mission, sequential_achievement(TaskId(max(drill, 2)), THIS))
    return story.returned(mission).at(5.0)


def delayed() -> Story:
    """Candles are lit three seconds after a bell, which is rung at 500 s."""
    story = Story().module("waiter", "ring bell", "light candles").at(1.0)
    at_500 = Constraint(Point(TaskId(0), Moment.END_ACHIEVING), Point(THIS, Moment.START_ACHIEVING), 500.25)
    bell = story.command("ring bell", "user", 0, at_500)
    later = Constraint(Point(TaskId(bell), Moment.END_ACHIEVING), Point(THIS, Moment.START_ACHIEVING), 3.0)
    story.command("light candles", "user", 0, later)
    return story.at(2.0)
