"""Transcripts: a story of commands, each followed by ``----`` and everything that central did about it.

    module NAME [handles CLASS MESSAGE, ...] [capacity N] [pool NAME] [pending N]
    NAME: CLASS MESSAGE [under TASK] [flags A|B] [priority N] [maximum N] [again] [if handled] [where POINT <= POINT, ...]
    NAME: await MESSAGE, ...
    NAME: set VARIABLE NUMBER | swap VARIABLE NUMBER | get VARIABLE
    NAME: reply [ID] | fail FAILURE [ID] | wait POINT | give up | kill TASK | constrain POINT <= POINT, ... | bye
    lose NAME | garbage NAME | tree

A point is ``end achieving 3`` or ``start planning this``. A module's slots are NAME/1, NAME/2, ...
"""

import re
from typing import Any

import msgspec
from central.player import Player

from tca_central import notices
from tca_central.agenda import held_counts
from tca_wire import facts, headers
from tca_wire.constraints import Constraint, Flags
from tca_wire.facts import fields_of, kind_of
from tca_wire.headers import MessageClass
from tca_wire.points import THIS, Moment, Point, TaskId, describe_moments

CLASSES = "|".join(sorted(MessageClass, key=len, reverse=True))


class Transcript:
    def __init__(self) -> None:
        self.player = Player()
        self.shown = 0
        self.declared: set[tuple[str, str]] = set()

    def play(self, command: str) -> str:
        """Do one command; what happened, a line each."""
        self.shown = len(self.player.entries)
        for pattern, do in COMMANDS:
            if match := re.fullmatch(pattern, command):
                answers = do(self, **match.groupdict()) or []
                break
        else:
            raise ValueError(f"no such command: {command}")
        lines = [describe(fact) for entry in self.player.entries[self.shown :] for fact in entry.facts]
        lines += [f"  -> {describe_answer(answer)}" for answer in answers if not isinstance(answer, headers.Deliver)]
        return "\n".join(line for line in lines if line) if command != "tree" else self.tree()

    def module(self, name: str, handles: str, capacity: str, pool: str, pending: str) -> list[Any]:
        words = [part.strip() for part in handles.split(",")] if handles else []
        known = {connection: len(inbox) for connection, inbox in self.player.inbox.items()}
        self.player.module(name, *words, capacity=int(capacity or 1), pool=pool or "", pending=int(pending or 0))
        new = [item for connection, inbox in self.player.inbox.items() for item in inbox[known.get(connection, 0) :]]
        return [header for header, _ in new if isinstance(header, headers.Answer)]

    def send(self, name: str, what: str, options: str) -> list[Any]:
        message = what.split(" ", 1)[1]
        if (name, what) not in self.declared:
            self.declared.add((name, what))
            self.player.declare(name, what)
        where = re.search(r"where (.*)", options)
        found = dict(re.findall(r"\b(under|flags|priority|maximum) (\S+)", options))
        keywords: dict[str, Any] = {key: int(found[key]) for key in ("under", "priority", "maximum") if key in found}
        if "flags" in found:
            keywords["flags"] = Flags(sum(Flags[flag] for flag in found["flags"].split("|")))
        if " if handled" in options:
            keywords["if_handled"] = True
        if " again" in options:
            keywords["number"] = self.player.numbers[name]
        self.shown = len(self.player.entries)
        return self.player.send(name, message, constraints=constraints(where[1]) if where else (), **keywords)

    def await_(self, name: str, messages: str) -> list[Any]:
        names = [message.strip() for message in messages.split(",")]
        return self.player.receive(name, headers.WaitUntilHandled(self.player.number(name), names))

    def variable(self, name: str, what: str, variable: str, value: str) -> list[Any]:
        if (name, variable) not in self.declared:
            self.declared.add((name, variable))
            self.player.declare(name, f"variable {variable}")
        if what == "set":
            return self.player.set_variable(name, variable, int(value))
        if what == "swap":
            answers = self.player.set_variable(name, variable, int(value), swap=True)
        else:
            answers = self.player.receive(name, headers.GetVariable(self.player.number(name), variable))
        bodies = [body for header, body in self.player.inbox[name][-1:] if isinstance(header, headers.Answer)]
        return [*answers, *(str(msgspec.msgpack.decode(body)) if body else "(never set)" for body in bodies)]

    def reply(self, name: str, delivery: str) -> list[Any]:
        return self.player.reply(name, int(delivery or 0))

    def fail(self, name: str, failure: str, delivery: str) -> list[Any]:
        return self.player.fail(name, failure, int(delivery or 0))

    def wait(self, name: str, point: str) -> list[Any]:
        return self.player.receive(name, headers.WaitFor(self.player.number(name), read_point(point)))

    def give_up(self, name: str) -> list[Any]:
        return self.player.receive(name, headers.GiveUp(self.player.numbers[name]))

    def kill(self, name: str, task: str) -> list[Any]:
        return self.player.receive(name, headers.Kill(self.player.number(name), TaskId(int(task))))

    def constrain(self, name: str, what: str) -> list[Any]:
        return self.player.receive(name, headers.Constrain(self.player.number(name), list(constraints(what))))

    def bye(self, name: str) -> list[Any]:
        return self.player.receive(name, headers.Bye())

    def lose(self, name: str) -> list[Any]:
        return [effect.header for effect in self.player.lose(name) if hasattr(effect, "header")]

    def garbage(self, name: str) -> list[Any]:
        return [effect.header for effect in self.player.garbage(name) if hasattr(effect, "header")]

    def tree(self) -> str:
        tree, lines = self.player.central.tree, []
        for task in list(tree.subtree(tree.root))[1:]:
            depth = sum(1 for _ in task.lineage()) - 1
            held = ", ".join(f"{describe_moments(m)[0]} held by {n}" for m, n in held_counts(task).items())
            reached = ", ".join(describe_moments(task.reached)) or "nothing yet"
            lines.append(f"{'  ' * depth}{task.id} {task.message.name}: {reached}{f' ({held})' if held else ''}")
        return "\n".join(lines) or "(empty)"


NAME = r"(?P<name>[\w/#]+)"
OPTIONS = r"(?: capacity (?P<capacity>\d+))?(?: pool (?P<pool>\w+))?(?: pending (?P<pending>\d+))?"
COMMANDS: list[tuple[str, Any]] = [
    (rf"module {NAME}(?: handles (?P<handles>.*?))?{OPTIONS}", Transcript.module),
    (rf"{NAME}: await (?P<messages>.*)", Transcript.await_),
    (rf"{NAME}: (?P<what>set|swap|get) (?P<variable>\w+)(?: (?P<value>\d+))?", Transcript.variable),
    (rf"{NAME}: reply(?: (?P<delivery>\d+))?", Transcript.reply),
    (rf"{NAME}: fail (?P<failure>\D+?)(?: (?P<delivery>\d+))?", Transcript.fail),
    (rf"{NAME}: wait (?P<point>.*)", Transcript.wait),
    (rf"{NAME}: give up", Transcript.give_up),
    (rf"{NAME}: kill (?P<task>\d+)", Transcript.kill),
    (rf"{NAME}: constrain (?P<what>.*)", Transcript.constrain),
    (rf"{NAME}: bye", Transcript.bye),
    (rf"lose {NAME}", Transcript.lose),
    (rf"garbage {NAME}", Transcript.garbage),
    (r"tree", lambda _: None),
    (rf"{NAME}: (?P<what>(?:{CLASSES}) \w+)(?P<options>.*)", Transcript.send),
]  # fmt: skip


def read_point(text: str) -> Point:
    edge, interval, task = text.split()
    return Point(THIS if task == "this" else TaskId(int(task)), Moment[f"{edge}_{interval}".upper()])


def constraints(text: str) -> tuple[Constraint, ...]:
    pairs = [part.split("<=") for part in text.split(",")]
    return tuple(Constraint(read_point(before.strip()), read_point(after.strip())) for before, after in pairs)


def describe(fact: facts.Fact) -> str:
    """A fact in a line; formats, and constraints that everyone sees, are left out."""
    match fact:
        case facts.Received():
            under = f" under {fact.parent}" if fact.parent else ""
            held = "".join(f"\n  {constraint}" for constraint in fact.constraints)
            told = f": {msgspec.msgpack.decode(fact.body)}" if fact.sender == notices.SENDER else ""
            return f"received {fact.message_class} {fact.message} as {fact.id} from {fact.sender}{under}{told}{held}"
        case facts.Constrained():
            return "\n".join(f"constrained {constraint}" for constraint in fact.constraints)
        case facts.Reached():
            return f"{fact.task} reached {', '.join(describe_moments(fact.moments))}"
        case facts.Delivered():
            what = "" if fact.id == fact.message_id else f" (message {fact.message_id})"
            return f"{fact.id}{what} delivered to {fact.module}"
        case facts.Queued():
            return f"{fact.id} waits for {fact.module or 'a handler'}"
        case facts.FormatDefined() | facts.ResourceChanged() | facts.RequestRefused():
            return ""
        case facts.ModuleJoined():
            return f"module {fact.module} joined"
        case facts.HandlerAdded() | facts.HandlerRemoved():
            return f"module {fact.module} {'handles' if kind_of(fact) == 'handler' else 'no longer handles'} {fact.message}"
        case facts.Returned():
            return f"handler of {fact.id} returned: {fact.outcome}"
        case _:
            return f"{kind_of(fact)}: " + ", ".join(f"{key} {value}" for key, value in fields_of(fact).items())


def describe_answer(answer: Any) -> str:
    """A header in a line; or a value, of a variable."""
    return f"value {answer}" if isinstance(answer, str) else describe_header(answer)


def describe_header(header: Any) -> str:
    fields = {name: getattr(header, name) for name in header.__struct_fields__ if name not in ("number", "version")}
    words = ", ".join(f"{key} {value}" for key, value in fields.items() if value not in ("", False, 0))
    return f"{type(header).__name__.lower()} {words}".strip()
