"""Transcripts: stories of commands. Each group of commands is followed by ``----`` and everything
that central did.

A group of commands uses these forms. NAME is a module, or one of its slots: NAME/1, NAME/2, ...

```
module NAME [handles CLASS MESSAGE, ...] [capacity N] [pool NAME] [pending N] [resource NAME]
            [accepting] [taking TRANSITION and ...] [refusing TRANSITION and ...]
            [when busy BUSY] [life cycle LIFE CYCLE]
line NAME of MODULE [in RESOURCE] [run INCARNATION]              one more connection
lose NAME                                                        its connection breaks
garbage NAME                                                     it sends no valid packet
NAME: bye
NAME: handle MESSAGE no more
NAME: declare CLASS MESSAGE of PART, PART, ...                   for monitors
NAME: declare CLASS MESSAGE retry <FIELD=JSON ...>               for all modules that declare it later

NAME: CLASS MESSAGE [under TASK] [flags A|B] [priority N] [maximum N] [deadline N] [when killed]
            [again] [if handled] [kept] [suspended] [from outside] [here]
            [where POINT <= POINT, ...] [handlers FAILURE->HANDLER[*MAXIMUM], ...]
            [retry <FIELD=JSON ...>]       a retry policy; before where, handlers
            and for monitors: [every N] [at first] [duration N] [fire every N] [until POINT]
            [waited for]
NAME: reply [ID] [with VALUE]
NAME: fail FAILURE[<KIND...] [ID]
NAME: reissue [ID]
NAME: resolve [ID]
NAME: wait POINT [here]
NAME: await the last N                 a coroutine awaits its last N requests; 0: it continues
NAME: await MESSAGE, ... [to handle MESSAGE]   waits until they have handlers
NAME: give up [and ask why]

NAME: attach FAILURE->HANDLER[*MAXIMUM] to TASK or MESSAGE
NAME: remove ID                        its own share in it
NAME: detach ID                        for all modules
NAME: raise FAILURE[<KIND...] on TASK
NAME: retry TASK [with data]
NAME: suspend TASK
NAME: resume TASK
NAME: deadline N for POINT
NAME: constrain POINT <= POINT, ...
NAME: kill [descendants of, siblings of] TASK [in N] [after POINT] [because TEXT]
NAME: keep TASK
NAME: release TASK
NAME: inspect RELATION of TASK
NAME: take TRANSITION of TASK [with VALUE] [having seen SERIAL] [because TEXT]
NAME: observe [TASK, MESSAGE] [below TASK] [states STATE or ...]
NAME: tap CONDITION of TASK or MESSAGE with LISTENER [at once [of NAME]] [options of monitors]
NAME: fire TASK or MESSAGE [with ACTION]
NAME: end monitor TASK
NAME: lock RESOURCE [of MODULE] [here | for DELIVERY] [within SECONDS] [priority N]
NAME: reserve RESOURCE ...                                       options as for lock
NAME: release
NAME: unlock RESOURCE
NAME: set VARIABLE NUMBER
NAME: swap VARIABLE NUMBER
NAME: get VARIABLE
NAME! HEADER FIELD=JSON ... [with JSON]                          any other request

event EVENT FIELD=JSON ...                                       any other event
pass SECONDS
limits LISTENERS DEPTH                 the greatest chain of listeners, and depth of tasks
heard                                  all headers that each connection got since the last "heard"
tree
load
waits TASK
```

`again`: the same request number once more. `from outside`: sent by code outside of handlers.
`here`: the running handler of NAME blocks until the answer arrives. A point is written
``end achieving 3``, ``start planning this``, or as a number of seconds from now.
``POINT + 2`` is two seconds later. The failure without a name is written ``any``.
"""

import json
import re
from typing import Any

import msgspec
from central.player import INTEGER, Player
from central.transcript_words import (
    constraints,
    describe,
    describe_answer,
    describe_header,
    describe_inspected,
    describe_observed,
    load_lines,
    read_attachment,
    read_fields,
    read_point,
    read_watch,
)

from tca_central import events
from tca_central.events import LimitsSet
from tca_central.needs.waits import Ends, next_of, waits_of
from tca_central.order.holds import held_counts
from tca_central.status.load import load
from tca_wire.constraints import Flags
from tca_wire.life_cycles import (
    BASIC,
    GENERAL,
    ONE_UPDATE,
    ROS_GOAL,
    LifeCycle,
    Transition,
    ending,
)
from tca_wire.packets import changes, headers
from tca_wire.packets.parts import MessageFormat, RetryPolicy
from tca_wire.points import ROOT, TaskId, describe_moments
from tca_wire.text.waits_in_words import in_words
from tca_wire.vocabulary import Busy, Condition, MessageClass, Party, Scope

PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("resume", "paused", "running", Party.BOTH),
        *ending("paused"),
    ],
)
SKIPPABLE = LifeCycle(
    "skippable",
    [
        *PAUSABLE.transitions[:-2],  # a paused task can't end
        Transition("hide", "running", "hidden"),
        Transition("show", "hidden", "running"),
        Transition("skip", "running", "skipped"),
        Transition("lose", "running", "lost"),
        Transition("module lost", "running", "lost"),
    ],
    done=["done", "skipped"],
    cancelled=["cancelled", "lost"],
)
LIFE_CYCLES = {one.name: one for one in (BASIC, PAUSABLE, SKIPPABLE, ONE_UPDATE, ROS_GOAL)}
HEADERS: dict[str, Any] = {
    kind.__name__: kind
    for module in (headers, changes)
    for kind in vars(module).values()
    if isinstance(kind, type)
}
CLASSES = "|".join(sorted(MessageClass, key=len, reverse=True))


class Transcript:
    def __init__(self) -> None:
        self.player = Player()
        self.shown = 0
        self.declared: set[tuple[str, str]] = set()
        self.locked: dict[str, int] = {}
        self.asked: dict[str, list[int]] = {}
        self.observing: dict[
            str, set[int]
        ] = {}  #: by connection: the numbers of its requests to observe
        self.read: dict[str, int] = {}
        self.shown_headers: dict[str, int] = {}

    def play(self, command: str) -> str:
        """Play one command. Return a line for each thing that happened."""
        self.shown = len(self.player.entries)
        for pattern, do in COMMANDS:
            if match := re.fullmatch(pattern, command):
                answers = do(self, **match.groupdict()) or []
                break
        else:
            raise ValueError(f"no such command: {command}")
        lines = [
            describe(fact) for entry in self.player.entries[self.shown :] for fact in entry.facts
        ]
        answers = [answer for answer in answers if not isinstance(answer, headers.Deliver)]
        lines += [
            f"  -> {describe_answer(answer)}" for answer in answers if not self.is_observed(answer)
        ]
        lines += self.observations()
        if report := re.fullmatch(r"(tree|load|waits|heard) ?(.*)", command):
            return str(getattr(self, report[1])(*filter(None, [report[2]])))
        return "\n".join(line for line in lines if line)

    def is_observed(self, answer: Any) -> bool:
        """Whether an answer belongs to an observer, so that `observations` shows it."""
        return isinstance(answer, headers.Answer) and any(
            answer.number in numbers for numbers in self.observing.values()
        )

    def observations(self) -> list[str]:
        """Return a line for each change that central has sent to an observer since the last
        command.
        """
        lines = []
        for name, numbers in self.observing.items():
            inbox = self.player.inbox[name]
            new, self.read[name] = inbox[self.read[name] :], len(inbox)
            observed = [
                item
                for item in new
                if isinstance(item[0], headers.Answer) and item[0].number in numbers
            ]
            lines += [f"  -> {name} {describe_observed(header, body)}" for header, body in observed]
        return lines

    def module(
        self, name: str, handles: str, capacity: str, pending: str, **options: str
    ) -> list[Any]:
        words = [part.strip() for part in handles.split(",")] if handles else []
        known = {connection: len(inbox) for connection, inbox in self.player.inbox.items()}
        if life_cycle := options["life_cycle"]:
            for part in words:
                self.player.life_cycles[self.player.format(part).name] = LIFE_CYCLES[
                    life_cycle
                ].text
        chosen = {
            "pool": options["pool"] or "",
            "resource": options["resource"] or "",
            **life_cycle_options(**options),
        }
        self.player.module(
            name, *words, capacity=int(capacity or 1), pending=int(pending or 0), **chosen
        )
        new = [
            item
            for connection, inbox in self.player.inbox.items()
            for item in inbox[known.get(connection, 0) :]
        ]
        return [header for header, _ in new if isinstance(header, headers.Answer | headers.Refused)]

    def send(self, name: str, what: str, options: str) -> list[Any]:
        message = what.rsplit(" ", 1)[1]
        if (name, what) not in self.declared and "monitor" not in what:
            self.declared.add((name, what))
            self.player.declare(name, what)
        where = re.search(r"where ((?:(?! handlers ).)*)", options)
        found = dict(re.findall(r"\b(under|flags|priority|maximum|deadline) (\S+)", options))
        numbers = ("under", "priority", "maximum", "deadline")
        keywords: dict[str, Any] = {key: int(found[key]) for key in numbers if key in found}
        if retry := re.search(r"retry <(.*?)>", options):
            keywords["retry"] = RetryPolicy(**read_fields(RetryPolicy, retry[1]))
        if handlers := re.search(r"handlers (.*)", options):
            keywords["attachments"] = [read_attachment(part) for part in handlers[1].split(",")]
        keywords["when_killed"] = "when killed" in options
        if "monitor" in what:
            keywords["watch"] = read_watch(options)
        if "flags" in found:
            keywords["flags"] = Flags(sum(Flags[flag] for flag in found["flags"].split("|")))
        if " here" in options:
            keywords |= {"origin": self.player.delivered(name)[-1], "blocking": True}
        if " from outside" in options:
            keywords["origin"] = 0
        keywords |= {"if_handled": " if handled" in options, "keep": " kept" in options}
        keywords["suspended"] = " suspended" in options
        if " again" in options:
            keywords["number"] = self.player.numbers[name]
        self.shown = len(self.player.entries)
        answers = self.player.send(
            name, message, constraints=constraints(where[1]) if where else (), **keywords
        )
        self.asked.setdefault(name, []).append(self.player.numbers[name])
        return answers

    def reply(self, name: str, delivery: str, value: str) -> list[Any]:
        return self.player.reply(
            name, int(delivery or 0), {"true": True, "false": False}.get(value, value)
        )

    def declare_retry(self, name: str, what: str, retry: str) -> list[Any]:
        message = self.player.format(what).name
        self.player.retries[message] = RetryPolicy(**read_fields(RetryPolicy, retry))
        return self.player.declare(name, what)

    def declare(self, name: str, message_class: str, message: str, parts: str) -> list[Any]:
        names = ["" if part.strip() == "none" else part.strip() for part in parts.split(",")]
        reply = INTEGER if message_class == "query" else ""
        declared = MessageFormat(message, MessageClass(message_class), INTEGER, reply, names)
        return self.player.request(name, headers.Register, [declared])

    def tap(self, name: str, condition: str, place: str, listener: str, options: str) -> list[Any]:
        where: dict[str, Any] = (
            {"task": TaskId(int(place))} if place.isdigit() else {"message": place}
        )
        where["watch"] = read_watch(options)
        if at_once := re.search(r"at once(?: of (\w+))?", options):
            where |= {"at_once": True, "of": at_once[1] or ""}
        return self.player.request(name, headers.Tap, Condition(condition), listener, **where)

    def fire(self, name: str, task: str, action: str) -> list[Any]:
        which: dict[str, Any] = (
            {"monitor": TaskId(int(task))} if task.isdigit() else {"monitor": ROOT, "message": task}
        )
        return self.player.request(name, headers.Fire, body=b"\x05", action=action or "", **which)

    def end_monitor(self, name: str, task: str) -> list[Any]:
        return self.player.request(name, headers.EndMonitor, TaskId(int(task)))

    def await_messages(self, name: str, messages: str, promised: str) -> list[Any]:
        names = [message.strip() for message in messages.split(",")]
        promises = [promised] if promised else []
        return self.player.request(name, headers.WaitUntilHandled, names, promises)

    def variable(self, name: str, what: str, variable: str, value: str) -> list[Any]:
        if (name, variable) not in self.declared:
            self.declared.add((name, variable))
            self.player.declare(name, f"variable {variable}")
        if what == "set":
            return self.player.set_variable(name, variable, int(value))
        if what == "swap":
            answers = self.player.set_variable(name, variable, int(value), swap=True)
        else:
            answers = self.player.request(name, headers.GetVariable, variable)
        bodies = [
            body
            for header, body in self.player.inbox[name][-1:]
            if isinstance(header, headers.Answer)
        ]
        return [
            *answers,
            *(str(msgspec.msgpack.decode(body)) if body else "(never set)" for body in bodies),
        ]

    def fail(self, name: str, failure: str, delivery: str) -> list[Any]:
        failure, *kinds = failure.split("<")
        return self.player.fail(name, failure, int(delivery or 0), kinds=kinds)

    def reissue(self, name: str, delivery: str) -> list[Any]:
        return self.player.fail(name, "", int(delivery or 0), reissue=True)

    def resolve(self, name: str, delivery: str) -> list[Any]:
        return self.player.resolve(name, int(delivery or 0))

    def attach(self, name: str, what: str, where: str) -> list[Any]:
        place = {"task": TaskId(int(where))} if where.isdigit() else {"message": where}
        return self.player.request(name, headers.Attach, read_attachment(what), **place)

    def remove(self, name: str, which: str) -> list[Any]:
        return self.player.request(name, headers.Remove, int(which))

    def detach(self, name: str, which: str) -> list[Any]:
        return self.player.request(name, headers.Remove, int(which), for_all=True)

    def raise_(self, name: str, failure: str, task: str) -> list[Any]:
        failure, *kinds = failure.split("<")
        return self.player.request(
            name, headers.Raise, TaskId(int(task)), failure, "why", kinds, body=b"\x07"
        )

    def retry(self, name: str, task: str, data: str) -> list[Any]:
        return self.player.request(name, headers.Retry, TaskId(int(task)), bool(data), body=b"\x08")

    def suspend(self, name: str, what: str, task: str) -> list[Any]:
        return self.player.request(name, headers.Suspend, TaskId(int(task)), what == "resume")

    def keep(self, name: str, what: str, task: str) -> list[Any]:
        return self.player.request(name, headers.Keep, TaskId(int(task)), what == "release")

    def inspect(self, name: str, relation: Any, task: str) -> list[Any]:
        self.player.request(name, headers.Inspect, TaskId(int(task)), relation)
        header, body = self.player.inbox[name][-1]
        if isinstance(header, headers.Refused):
            return [header]
        return [describe_inspected(row) for row in msgspec.msgpack.decode(body)] or ["(nothing)"]

    def take(
        self, name: str, transition: str, task: str, value: str, serial: str, text: str
    ) -> list[Any]:
        data = int(value) if value else None
        return self.player.change(
            name, int(task), transition, data, serial=int(serial or -1), text=text or ""
        )

    def observe(self, name: str, task: str, message: str, below: str, states: str) -> list[Any]:
        self.observing.setdefault(name, set()).add(self.player.numbers.get(name, 0) + 1)
        self.read.setdefault(name, len(self.player.inbox.get(name, ())))
        return self.player.observe(
            name,
            task=TaskId(int(task or 0)),
            message=message or "",
            below=TaskId(int(below or 0)),
            states=states.split(" or ") if states else [],
        )

    def deadline(self, name: str, seconds: str, point: str) -> list[Any]:
        return self.player.request(name, headers.Deadline, read_point(point), float(seconds))

    def pass_(self, seconds: str) -> list[Any]:
        return [
            effect.header
            for effect in self.player.tick(float(seconds))
            if hasattr(effect, "header")
        ]

    def wait(self, name: str, point: str, here: str) -> list[Any]:
        origin = self.player.delivered(name)[-1] if here else 0
        return self.player.request(
            name, headers.AwaitPoint, read_point(point), origin, blocking=bool(here)
        )

    def await_requests(self, name: str, number: str) -> list[Any]:
        requests = self.asked[name][-int(number) :] if int(number) else []
        return self.player.receive(
            name, headers.AwaitAny(self.player.delivered(name)[-1], requests)
        )

    def give_up(self, name: str, asks: str) -> list[Any]:
        request = self.player.numbers[name]
        return self.player.receive(
            name, headers.GiveUp(request, self.player.number(name) if asks else 0)
        )

    def lock(self, name: str, what: str, resource: str, options: str) -> list[Any]:
        found = dict(re.findall(r"\b(of|within|priority|for) (\S+)", options))
        self.locked[name] = self.player.number(name)
        header = headers.Lock(
            self.locked[name],
            resource,
            found.get("of", ""),
            what == "reserve",
            self.player.delivered(name)[-1] if " here" in options else int(found.get("for", 0)),
            float(found.get("within", -1)),
            int(found.get("priority", 0)),
            blocking=" here" in options,
        )
        return self.player.receive(name, header)

    def release(self, name: str) -> list[Any]:
        return self.player.receive(name, headers.GiveUp(self.locked[name]))

    def unlock(self, name: str, resource: str) -> list[Any]:
        return self.player.request(name, headers.Unlock, resource)

    def kill(self, name: str, scope: str, task: str, delay: str, after: str, why: str) -> list[Any]:
        point = read_point(after) if after else None
        which = Scope(scope or "task")
        return self.player.request(
            name, headers.Kill, TaskId(int(task)), why or "", which, point, float(delay or 0)
        )

    def constrain(self, name: str, what: str) -> list[Any]:
        return self.player.request(name, headers.Constrain, list(constraints(what)))

    def bye(self, name: str) -> list[Any]:
        return self.player.receive(name, headers.Bye())

    def unregister(self, name: str, message: str) -> list[Any]:
        return self.player.request(name, headers.Unregister, [message])

    def lose(self, name: str) -> list[Any]:
        return [effect.header for effect in self.player.lose(name) if hasattr(effect, "header")]

    def garbage(self, name: str) -> list[Any]:
        return [effect.header for effect in self.player.garbage(name) if hasattr(effect, "header")]

    def line(self, name: str, module: str, resource: str, run: str) -> list[Any]:
        return self.player.hello(name, module, resource or "", run or "")

    def request(self, name: str, kind: str, fields: str, body: str) -> list[Any]:
        """Send a header with these fields, and with the next number if it has one."""
        header = HEADERS[kind]
        known = read_fields(header, fields)
        if "number" in header.__struct_fields__ and "number" not in known:
            known["number"] = self.player.number(name)
        if header is headers.Hello:
            known["version"] = headers.PROTOCOL_VERSION
        return self.player.receive(
            name, header(**known), msgspec.msgpack.encode(json.loads(body)) if body else b""
        )

    def event(self, kind: str, fields: str) -> list[Any]:
        made = getattr(events, kind)
        effects = self.player.event(made(self.player.time, **read_fields(made, fields)))
        return [effect.header for effect in effects if hasattr(effect, "header")]

    def heard(self) -> str:
        """Return the new headers that central sent to each connection, except deliveries and
        welcomes.
        """
        lines = []
        for name, inbox in self.player.inbox.items():
            for header, body in inbox[self.shown_headers.get(name, 0) :]:
                if not isinstance(header, headers.Deliver | headers.Welcome):
                    lines.append(f"{name} hears {describe_header(header)}{_value(header, body)}")
            self.shown_headers[name] = len(inbox)
        return "\n".join(lines)

    def load(self) -> str:
        """Return the load that central reports."""
        return "\n".join(load_lines(load(self.player.central)))

    def waits(self, task: str) -> str:
        """Return the waits of a task, and the last wait of their chain."""
        central = self.player.central
        node = next_of(central.tree.tasks[TaskId(int(task))])
        found = [f"{one.kind}: {in_words(one)}" for one in waits_of(central, node)]
        end = Ends(central, 1000).end_of(node)
        return "\n".join(
            [*found, f"in the end {end.kind}: {in_words(end)}" if end else "no end is known"]
        )

    def limits(self, taps: str, depth: str) -> None:
        self.player.event(LimitsSet(self.player.time, 512 << 20, int(taps), int(depth)))

    def tree(self) -> str:
        tree, lines = self.player.central.tree, []
        for task in list(tree.subtree(tree.root))[1:]:
            depth = sum(1 for _ in task.lineage()) - 1
            held = ", ".join(
                f"{describe_moments(m)[0]} held by {n}" for m, n in held_counts(task).items()
            )
            reached = ", ".join(describe_moments(task.reached)) or "nothing yet"
            lines.append(
                f"{'  ' * depth}{task.id} {task.message.name}: {reached}{f' ({held})' if held else ''}"
            )
        return "\n".join(lines) or "(empty)"


def _value(header: Any, body: bytes) -> str:
    """Return the value of an answer, in words."""
    return (
        f", value {msgspec.msgpack.decode(body)}"
        if body and isinstance(header, headers.Answer)
        else ""
    )


def life_cycle_options(
    *, accepting: str, taking: str, refusing: str, busy: str, **_: str
) -> dict[str, Any]:
    """Return the options of a module's handlers for the life cycles of tasks."""
    options: dict[str, Any] = {"accepts": True} if accepting else {}
    options |= {"takes": taking.split(" and ")} if taking else {}
    options |= {"refuses": refusing.split(" and ")} if refusing else {}
    return options | ({"busy": Busy(busy)} if busy else {})


NAME = r"(?P<name>[\w/#]+)"
OPTIONS = (
    r"(?: capacity (?P<capacity>\d+))?(?: pool (?P<pool>\w+))?(?: pending (?P<pending>\d+))?(?: resource (?P<resource>\w+))?"
    r"(?P<accepting> accepting)?(?: taking (?P<taking>[\w ]+?))?(?: refusing (?P<refusing>[\w ]+?))?(?: when busy (?P<busy>\w+))?"
    r"(?: life cycle (?P<life_cycle>[\w ]+))?"
)
TAKEN = r"(?: with (?P<value>\d+))?(?: having seen (?P<serial>\d+))?(?: because (?P<text>.*))?"
KILLED = r"(?: in (?P<delay>[\d.]+))?(?: after (?P<after>[a-z ]+\d+))?(?: because (?P<why>.*))?"
OBSERVED = r"(?: (?P<task>\d+))?(?: (?!below|states)(?P<message>\w+))?(?: below (?P<below>\d+))?(?: states (?P<states>.*))?"
COMMANDS: list[tuple[str, Any]] = [
    (rf"module {NAME}(?: handles (?P<handles>.*?))?{OPTIONS}", Transcript.module),
    (rf"{NAME}: await the last (?P<number>\d+)", Transcript.await_requests),
    (rf"{NAME}: await (?P<messages>.*?)(?: to handle (?P<promised>.*))?", Transcript.await_messages),
    (rf"{NAME}: (?P<what>set|swap|get) (?P<variable>\w+)(?: (?P<value>\d+))?", Transcript.variable),
    (rf"{NAME}: reply(?: (?P<delivery>\d+))?(?: with (?P<value>\w+))?", Transcript.reply),
    (rf"{NAME}: declare (?P<what>[\w ]+) retry <(?P<retry>.*?)>", Transcript.declare_retry),
    (rf"{NAME}: declare (?P<message_class>[\w ]+) (?P<message>\w+) of (?P<parts>.*)", Transcript.declare),
    (rf"{NAME}: tap (?P<condition>[\w ]+) of (?P<place>\w+) with (?P<listener>\w+)(?P<options>.*)", Transcript.tap),
    (rf"{NAME}: fire (?P<task>\w+)(?: with (?P<action>\w+))?", Transcript.fire),
    (rf"{NAME}: end monitor (?P<task>\d+)", Transcript.end_monitor),
    (rf"{NAME}: fail (?P<failure>\D+?)(?: (?P<delivery>\d+))?", Transcript.fail),
    (rf"{NAME}: reissue(?: (?P<delivery>\d+))?", Transcript.reissue),
    (rf"{NAME}: resolve(?: (?P<delivery>\d+))?", Transcript.resolve),
    (rf"{NAME}: attach (?P<what>.+) to (?P<where>\w+)", Transcript.attach),
    (rf"{NAME}: remove (?P<which>\d+)", Transcript.remove),
    (rf"{NAME}: detach (?P<which>\d+)", Transcript.detach),
    (rf"{NAME}: raise (?P<failure>.+) on (?P<task>\d+)", Transcript.raise_),
    (rf"{NAME}: retry (?P<task>\d+)(?P<data> with data)?", Transcript.retry),
    (rf"{NAME}: (?P<what>suspend|resume) (?P<task>-?\d+)", Transcript.suspend),
    (rf"{NAME}: (?P<what>keep|release) (?P<task>\d+)", Transcript.keep),
    (rf"{NAME}: inspect (?P<relation>\w+) of (?P<task>\d+)", Transcript.inspect),
    (rf"{NAME}: take (?P<transition>[\w ]+?) of (?P<task>\d+){TAKEN}", Transcript.take),
    (rf"{NAME}: observe{OBSERVED}", Transcript.observe),
    (rf"{NAME}: deadline (?P<seconds>[\d.]+) for (?P<point>.*)", Transcript.deadline),
    (r"pass (?P<seconds>[\d.]+)", Transcript.pass_),
    (rf"{NAME}: wait (?P<point>.*?)(?P<here> here)?", Transcript.wait),
    (rf"{NAME}: give up(?P<asks> and ask why)?", Transcript.give_up),
    (rf"{NAME}: kill (?:(?P<scope>descendants|siblings) of )?(?P<task>-?\d+){KILLED}", Transcript.kill),
    (rf"{NAME}: constrain (?P<what>.*)", Transcript.constrain),
    (rf"{NAME}: bye", Transcript.bye),
    (rf"{NAME}: handle (?P<message>\w+) no more", Transcript.unregister),
    (rf"lose {NAME}", Transcript.lose),
    (rf"garbage {NAME}", Transcript.garbage),
    (rf"{NAME}: (?P<what>lock|reserve) (?P<resource>\w+)(?P<options>.*)", Transcript.lock),
    (rf"{NAME}: release", Transcript.release),
    (rf"{NAME}: unlock (?P<resource>\w+)", Transcript.unlock),
    (rf"line {NAME} of (?P<module>.+?)(?: in (?P<resource>\w+))?(?: run (?P<run>.+?))?", Transcript.line),
    (rf"{NAME}! (?P<kind>\w+)(?P<fields>(?: \w+=.*?)?)(?: with (?P<body>.*))?", Transcript.request),
    (r"event (?P<kind>\w+)(?P<fields>.*)", Transcript.event),
    (r"tree|heard|load|waits \d+", lambda _: None),
    (r"limits (?P<taps>\d+) (?P<depth>\d+)", Transcript.limits),
    (rf"{NAME}: (?P<what>(?:{CLASSES}) \w+)(?P<options>.*)", Transcript.send),
]  # fmt: skip
