"""Random lives of a robot. Numbers become operations that some module could do at that time."""

import random
from typing import Any, Self

from central.player import INTEGER, Player, before, point
from hypothesis import strategies as st
from sampling import lives

from tca_central.core import Central
from tca_central.events import ConnectionId
from tca_central.model.contexts import listener_cause, monitor_of, trouble_of
from tca_central.model.deliveries import Delivery
from tca_central.model.tasks import Task
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Delivered, Received
from tca_wire.messages.notices import HANDLERS_CHANGED, MODULE_JOINED, MODULE_LEFT
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, RetryPolicy, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Role, Scope

MODULES = {
    "planner": ("goal walk", "goal step", "query where", f"broadcast {HANDLERS_CHANGED.name}"),
    "legs": ("command move", "command lift", "inform note", f"broadcast {MODULE_LEFT.name}"),
    "map": (
        "query where",
        "multi-query all",
        "broadcast pose",
        "variable mode",
        f"broadcast {MODULE_JOINED.name}",
    ),
    "expert": ("exception handler recover", "exception handler report"),
}
MESSAGES = [message for handled in MODULES.values() for message in handled] + ["command later"]
MONITORS = {
    "look": ("point monitor", ["where", "lift"]),
    "watch": ("polling monitor", ["where", "note"]),
    "guard": ("demon monitor", ["lift", "step", "note"]),
}
FAILURES = ("slipped", "stumbled", "module lost", "timeout", "")
small = st.integers(0, 1000)
OPERATIONS = (
    ["send"] * 8
    + ["reply"] * 8
    + ["fail"] * 3
    + [
        "kill",
        "constrain",
        "wait",
        "lose",
        "join",
        "bye",
        "give up",
        "attach",
        "attach",
        "remove",
        "raise",
        "retry",
        "suspend",
        "deadline",
        "pass",
        "pass",
        "tap",
        "tap",
        "fire",
        "end monitor",
        "monitor",
        "monitor",
        "set",
        "await",
        "keep",
        "keep",
        "release",
        "lock",
        "lock",
        "unclaim",
        "unclaim",
        "unlock",
        "unregister",
        "fetch",
    ]
)
LENDING_OPERATIONS = [*OPERATIONS, "postpone", "block", "block", "block"]
"""Also those by which slots are lent. Lives by a seed of an example keep their operations."""
operation = st.tuples(st.sampled_from(LENDING_OPERATIONS), small, small, small, small)
operations = st.lists(operation, max_size=lives(60, soak=200))
Operations = list[tuple[str, int, int, int, int]]
BEGINNING = ("send", "fire", "monitor", "set", "tap", "attach", "suspend", "constrain")
CROWDED, CONNECTIONS, ASIDES = 50, 20, 40
"""The limits of a long life: for tasks with queued messages, for connections, and for attachments
with taps.
"""


class Life:
    """A life of random operations. Numbers become operations that some module could do at that
    time.
    """

    modules = MODULES
    messages = MESSAGES
    pending: tuple[int, ...] = (2, 0, 3, 1)
    operations = OPERATIONS
    crowded = CROWDED

    def __init__(self, player: Player | None = None) -> None:
        self.player = player or Player()
        self.generation = 0
        self.player.module("user")
        self.player.declare("user", *self.messages)
        for module in self.modules:
            self.join(module)
        for name, (message_class, parts) in MONITORS.items():
            declared = MessageFormat(name, MessageClass(message_class), INTEGER, "", parts)
            self.request(headers.Register, [declared])

    @property
    def central(self) -> Central:
        return self.player.central

    def connections(self) -> list[str]:
        return [connection.decode() for connection in self.central.registry.connections]

    def join(self, module: str) -> None:
        self.generation += 1
        name = f"{module}{self.generation}"
        pending = self.pending[self.generation % len(self.pending)]
        pool = "all" if module == "map" else ""
        self.player.module(name, *self.modules[module], capacity=2, pool=pool, pending=pending)

    def copies_of(self, message: str) -> set[int]:
        """Return the delivery ids of all messages with this name."""
        sent = {fact.id for fact in self.player.facts(Received) if fact.message == message}
        return {fact.id for fact in self.player.facts(Delivered) if fact.message_id in sent}

    def live(self, operations: Operations) -> Self:
        for name, *numbers in operations:
            self.do(name, *numbers)
        return self

    def go_on(self, seed: int, events: int) -> None:
        """Live on for *events* more events of central. While the life is crowded, operations that
        begin something are replaced by operations that end tasks.
        """
        dice, end = random.Random(seed), self.central.event_count + events
        while self.central.event_count < end:
            name = dice.choice(self.operations)
            if self.crowd() > self.crowded and name in BEGINNING:
                name = dice.choice(["reply"] * 8 + ["pass", "pass", "kill", "give up"])
            if (
                name in ("tap", "attach")
                and len(self.central.taps) + len(self.central.attached) > ASIDES
            ):
                name = "remove"
            if name in ("join", "lose", "bye"):
                name = (
                    "join"
                    if len(self.connections()) < CONNECTIONS
                    else dice.choice(("lose", "bye"))
                )
            self.do(name, *(dice.randrange(1001) for _ in range(4)))

    def crowd(self) -> int:
        """Return the number of tasks and queued messages."""
        registry = self.central.registry
        resources = [
            resource
            for module in registry.modules.values()
            for resource in module.resources.values()
        ]
        waiting = [len(message.waiting) for message in registry.messages.values()]
        return (
            len(self.central.tree.tasks)
            + sum(waiting)
            + sum(resource.waiting for resource in resources)
        )

    def do(self, name: str, a: int, b: int, c: int, d: int) -> None:
        getattr(self, f"{name.replace(' ', '_')}_")(a, b, c, d)

    def send_(self, a: int, b: int, c: int, d: int) -> None:
        senders = self.connections()
        tasks = [0, *self.central.tree.tasks]
        siblings = min(3, len(tasks))  # few parents, so that tasks have siblings
        parent = tasks[c % len(tasks) if c % 2 else c % siblings]
        constraints = []
        if d % 4 == 0 and len(tasks) > 2:
            one, moment = tasks[1:][c % (len(tasks) - 1)], list(Moment)[d % 6]
            pair = [point(one, moment), point(-1, list(Moment)[a % 6])]
            delay = self.seconds(c % 5 if a % 2 == 0 else 0)
            one_point, other = pair if b % 2 else reversed(pair)
            constraints.append(before(one_point, other, delay))
            if b % 5 == 0:
                constraints.append(
                    before(
                        point(0, Moment.START_ACHIEVING),
                        point(-1, list(Moment)[c % 6]),
                        self.seconds(d % 5),
                    )
                )
        running = list(self.central.dispatcher.running.values())
        origin = running[a % len(running)].handling_id if running and b % 2 else 0
        self.player.send(
            senders[a % len(senders)],
            self.sent_name(b),
            under=parent,
            origin=origin,
            flags=Flags(d % 16),
            constraints=tuple(constraints),
            priority=d % 3,
            maximum=d % 3,
            deadline=self.seconds(d % 7 if a % 5 == 0 else 0),
            when_killed=c % 9 == 8,
            attachments=[
                self.attachment(b + n, d + n // 2) for n in range((c % 6 == 5) * (1 + a % 4))
            ],
            if_handled=a % 5 == 0,
            keep=b % 4 == 1,
            blocking=d % 5 == 1,
            brief=True,
            suspended=d % 11 == 7,
            retry=self.retry_policy(a, b, c, d),
        )

    def sent_name(self, b: int) -> str:
        return Player.format(self.messages[b % len(self.messages)]).name

    def seconds(self, number: int) -> float:
        """Return a delay of *number* seconds."""
        return float(number)

    def retry_policy(self, a: int, b: int, c: int, d: int) -> RetryPolicy | None:
        """Return the policy of every third message. Central refuses it for monitors."""
        if (a + b) % 3:
            return None
        return RetryPolicy(
            attempts=1 + c % 3,
            pause=self.seconds(d % 4),
            backoff=2,
            longest_pause=self.seconds(5),
            attempt_timeout=self.seconds(b % 5),
            failures=[FAILURES[c % 4]] if a % 4 == 0 else [],
            fallback=("", "lift", "step", "later")[a % 4],
            data=b"\x07" * (d % 2),
        )

    @staticmethod
    def attachment(a: int, b: int) -> Attachment:
        handler = "report" if a % 2 else "recover"
        return Attachment(FAILURES[b % len(FAILURES)], handler, b % 3)

    def reply_(self, a: int, *_: int) -> None:
        running = list(self.central.dispatcher.running.values())
        if running:
            delivery = running[a % len(running)]
            assert delivery.slot
            if a % 3 and delivery.role is Role.EXCEPTION:
                self.player.resolve(delivery.slot.id.decode(), delivery.handling_id)
            self.player.reply(delivery.slot.id.decode(), delivery.handling_id, value=a)

    def fail_(self, a: int, b: int, c: int, *_: int) -> None:
        running = list(self.central.dispatcher.running.values())
        if running:
            delivery = running[a % len(running)]
            assert delivery.slot
            failure, kinds = (
                FAILURES[b % 2],
                [FAILURES[1]] * (b % 3 == 0) + ["handler error"] * (c % 5 == 0),
            )
            failure = "handler error" if c % 5 == 1 else failure
            name, is_reissue = (
                delivery.slot.id.decode(),
                b % 4 == 3 or (b % 4 > 0 and delivery.role is Role.EXCEPTION),
            )
            self.player.fail(name, failure, delivery.handling_id, kinds=kinds, reissue=is_reissue)

    def postpone_(self, a: int, b: int, *_: int) -> None:
        """Let a handler return, and reply later. Its slot may be free."""
        running = list(self.central.dispatcher.running.values())
        if running:
            delivery = running[a % len(running)]
            assert delivery.slot
            postponed = headers.Postpone(delivery.handling_id, b % 2 == 0)
            self.player.receive(delivery.slot.id.decode(), postponed)

    def block_(self, a: int, b: int, c: int, d: int) -> None:
        """Let the handler of a task, or its coroutine, wait for a task: often for a new subtask."""
        handled = [one for one in self.central.dispatcher.running.values() if isinstance(one, Task)]
        if not handled:
            return
        handler = handled[a % len(handled)]
        assert handler.slot
        name, origin = handler.slot.id.decode(), handler.handling_id
        own = [
            one
            for one in handler.slot.module.handlers.values()
            if one.message.message_class.may_react and one.message.message_class.is_task
        ]
        if own and b % 4:
            message = own[c % len(own)].message.name
            self.player.send(
                name, message, under=handler.id, origin=origin, flags=Flags(d % 2), brief=True
            )
        tasks = [task.id for task in self.central.tree.tasks.values()]
        awaited = tasks[-1 if b % 4 else c % len(tasks)] if tasks else handler.id
        place = point(awaited, list(Moment)[5 if b % 2 else d % 6])
        kinds = {"blocking": d % 2 == 0, "lends_slot": d % 4 == 1, "brief": d % 8 == 0}
        self.player.receive(
            name, headers.AwaitPoint(self.player.number(name), place, origin, **kinds)
        )
        if d % 4 == 3:
            asked = headers.AwaitAny(origin, [self.player.numbers[name]])
            self.player.receive(name, asked)

    def request(self, header: type, *fields: Any, **options: Any) -> None:
        """Send a request of the user."""
        self.player.request("user", header, *fields, body=b"\x08", **options)

    def task(self, a: int) -> TaskId | None:
        """Return a living task, or for one *a* in 13 a recent task that may have ended. None
        without tasks.
        """
        tasks = list(self.central.tree.tasks)
        if a % 13 == 12:
            return TaskId(max(1, self.central.tree.newest - a % 5))
        return TaskId(tasks[a % len(tasks)]) if tasks else None

    def kill_(self, a: int, b: int, c: int, d: int) -> None:
        if task := self.task(a):
            after = self.task(c) if d % 3 == 0 else None
            place = point(after, list(Moment)[d % 6]) if after else None
            self.request(
                headers.Kill,
                task,
                "",
                list(Scope)[b % 7 if b % 7 < 3 else 0],
                place,
                self.seconds(d % 4),
            )

    def attach_(self, a: int, b: int, c: int, d: int) -> None:
        message = ("", "", "move", "walk")[c % 4]
        places = [
            one.place.id for one in self.central.attached.values() if isinstance(one.place, Task)
        ]
        shared = places[a % len(places)] if places and a % 4 else None  # several to one task
        task = shared if shared is not None else self.task(a) or TaskId(0)
        self.request(headers.Attach, self.attachment(b, d), TaskId(0) if message else task, message)

    def remove_(self, a: int, b: int, *_: int) -> None:
        tasks, for_all = self.central.tree.tasks.values(), b % 3 == 0
        monitors = (
            [task.id for task in tasks if task.message.message_class.is_monitor] if for_all else []
        )
        if asides := [*self.central.attached, *self.central.taps, *monitors]:
            self.request(headers.Remove, asides[a % len(asides)], for_all)

    def raise_(self, a: int, b: int, *_: int) -> None:
        if task := self.task(a):
            self.request(headers.Raise, task, FAILURES[b % 2])

    def retry_(self, a: int, b: int, c: int, d: int) -> None:
        handlers = [
            one for one in self.central.dispatcher.running.values() if one.role is Role.EXCEPTION
        ]
        handler = handlers[a % len(handlers)] if handlers and b % 3 else None
        name, task = "user", self.task(a)
        if handler is not None and handler.slot is not None:
            name = handler.slot.id.decode()
            path = list(trouble_of(handler).failing.lineage())
            task = TaskId(path[c % len(path)].id) if d % 4 else task  # that it may retry
        if task:
            self.player.request(name, headers.Retry, task, b % 2 == 0, body=b"\x08")

    def suspend_(self, a: int, b: int, *_: int) -> None:
        if task := self.task(a):
            self.request(headers.Suspend, task, b % 3 == 0)

    def deadline_(self, a: int, b: int, c: int, *_: int) -> None:
        if task := self.task(a):
            self.request(headers.Deadline, point(task, list(Moment)[b % 6]), self.seconds(c % 10))

    def tap_(self, a: int, b: int, c: int, d: int) -> None:
        conditions = list(Condition)
        message = ("", "move", "walk", "where", "lift", "watch")[c % 6]
        listeners = (
            ["note", "lift", "step", "pose"] * 2 + [*MONITORS] * 2 + ["recover", "where", "all"]
        )
        watch = self.watch_options(d, b, c) if d % 3 else None
        task, condition = self.task(d) or TaskId(0), conditions[a % len(conditions)]
        at_once, ended = (
            not message and a % 5 < 3,
            [*self.central.memory.outcomes, *self.central.memory.records],
        )
        if at_once and ended and c % 4 == 0:
            task = TaskId(ended[b % len(ended)])
        if message or task:
            listener = listeners[b % len(listeners)]
            self.request(
                headers.Tap, condition, listener, message, task, watch, at_once=at_once, of="move"
            )

    def monitor_(self, a: int, b: int, c: int, d: int) -> None:
        tasks = [0, *self.central.tree.tasks]
        options, name = self.watch_options(a, b, c, waited_for=d % 5 == 0), list(MONITORS)[a % 3]
        parent = tasks[c % len(tasks)]
        running, origin = list(self.central.dispatcher.running.values()), 0
        if running and d % 3 == 2:  # sent by a handler, under a cause of its call or any task
            handled = running[b % len(running)]
            origin, living = (
                handled.handling_id,
                [one for one in self.causes(handled) if one in tasks],
            )
            parent = living[c % len(living)] if living and a % 4 else parent
        elif parent and d % 3:  # sent by the parent's handler, running or returned
            task = self.central.tree.tasks[TaskId(parent)]
            is_or_was_handled = task.is_running or (task.returned and not task.killed)
            origin = (
                task.handling_id
                if is_or_was_handled and not task.message.message_class.is_monitor
                else 0
            )
        flags, is_suspended = Flags(d % 2), b % 11 == 7
        self.player.send(
            "user",
            name,
            under=parent,
            flags=flags,
            watch=options,
            origin=origin,
            suspended=is_suspended,
        )

    def causes(self, handled: Delivery) -> list[int]:
        """Return the tasks that may have caused the call of a handler."""
        if handled.role is Role.LISTENER:
            return [listener_cause(handled).tapped.task]
        if isinstance(handled, Task):
            return [int(one.id) for one in handled.lineage()]
        if handled.role:
            return [int(one.id) for one in monitor_of(handled).task.lineage()]
        sending = self.central.dispatcher.running.get(handled.origin)
        return [sending.id] if sending is not None else []

    def watch_options(self, a: int, b: int, c: int, *, waited_for: bool = False) -> WatchOptions:
        tasks = list(self.central.tree.tasks)
        until = (
            point(tasks[-1 - a % 2 * (len(tasks) - 1)], list(Moment)[c % 6])
            if b % 5 == 0 and tasks
            else None
        )
        period, duration = self.seconds(1 + c % 5), self.seconds(5 * (a % 3 == 0))
        return WatchOptions(period, c % 3, 1 + a % 2, b % 2 == 0, duration, until, waited_for)

    def monitors(self) -> list[Task]:
        return [
            task
            for task in self.central.tree.tasks.values()
            if task.message.message_class.is_monitor
        ]

    def fire_(self, a: int, b: int, *_: int) -> None:
        if monitors := self.monitors():
            one, action = monitors[a % len(monitors)], ("", "step", "lift")[b % 7 % 3]
            named = (
                {"monitor": TaskId(0), "message": one.message.name}
                if b % 5 == 0
                else {"monitor": TaskId(one.id)}
            )
            self.request(headers.Fire, action=action, **named)

    def end_monitor_(self, a: int, *_: int) -> None:
        if monitors := self.monitors():
            self.request(headers.EndMonitor, TaskId(monitors[a % len(monitors)].id))

    def keep_(self, a: int, b: int, *_: int) -> None:
        """Let a module retain a living task, or an ended one that central still retains."""
        tasks, names = [*self.central.tree.tasks, *self.central.memory.records], self.connections()
        if tasks:
            name = names[b % len(names)]
            self.player.request(name, headers.Keep, TaskId(tasks[a % len(tasks)]))

    def release_(self, a: int, b: int, *_: int) -> None:
        names = self.connections()
        name = names[b % len(names)]
        keeps = list(
            self.central.registry.connections[ConnectionId(name.encode())].module.retained
        ) or [TaskId(1)]
        self.player.request(name, headers.Keep, TaskId(keeps[a % len(keeps)]), release=True)

    def pass_(self, a: int, *_: int) -> None:
        self.player.tick(a % 10)

    def constrain_(self, a: int, b: int, c: int, d: int) -> None:
        tasks = [*self.central.tree.tasks, *self.central.memory.outcomes]
        if tasks:
            one, other = tasks[a % len(tasks)], tasks[b % len(tasks)]
            wanted = before(
                point(one, list(Moment)[c % 6]),
                point(other, list(Moment)[d % 6]),
                self.seconds(a % 4),
            )
            self.player.request("user", headers.Constrain, [wanted])

    def wait_(self, a: int, b: int, c: int, d: int) -> None:
        tasks = list(self.central.tree.tasks)
        if tasks:
            where = point(tasks[a % len(tasks)], list(Moment)[b % 6])
            self.player.request("user", headers.AwaitPoint, where)

    def set_(self, a: int, b: int, c: int, *_: int) -> None:
        senders = self.connections()
        sender = senders[a % len(senders)]
        if c % 4:
            self.player.set_variable(sender, "mode", b, swap=c % 2 == 0)
        else:
            self.player.request(sender, headers.GetVariable, "mode")

    def await_(self, a: int, b: int, c: int, *_: int) -> None:
        names = [self.messages[number % len(self.messages)].split(" ", 1)[1] for number in (a, b)]
        senders = self.connections()
        sender = senders[c % len(senders)]
        self.player.request(sender, headers.WaitUntilHandled, names)

    def give_up_(self, a: int, *_: int) -> None:
        self.player.receive("user", headers.GiveUp(1 + a % self.player.numbers["user"]))

    def fetch_(self, a: int, b: int, *_: int) -> None:
        """Let a connection wait for the reply to a request that the connection has sent."""
        names = self.connections()
        name = names[a % len(names)]
        number = 1 + b % (self.player.numbers.get(name, 0) + 1)
        self.player.receive(name, headers.Await(number, blocking=b % 3 > 0))

    def lock_(self, a: int, b: int, c: int, d: int) -> None:
        modules, running = (
            self.central.registry.modules.values(),
            list(self.central.dispatcher.running.values()),
        )
        resources = [resource for module in modules for resource in module.resources.values()]
        if not resources:
            return
        senders, resource, origin = self.connections(), resources[b % len(resources)], 0
        name = senders[a % len(senders)]
        if running and c % 4:  # for a running handler
            handled = running[a % len(running)]
            assert handled.slot
            name, origin = handled.slot.id.decode(), handled.handling_id
        timeout = self.seconds(d % 5) if c % 3 == 0 else -1
        number = self.player.number(name)
        wanted = headers.Lock(
            number, resource.name, resource.module, c % 2 == 0, origin, timeout, d % 3, bool(origin)
        )
        self.player.receive(name, wanted)

    def unclaim_(self, a: int, *_: int) -> None:
        if claims := list(self.central.claims.values()):
            claim = claims[a % len(claims)]
            self.player.receive(claim.slot.id.decode(), headers.GiveUp(claim.number))

    def unlock_(self, a: int, *_: int) -> None:
        modules = list(self.central.registry.modules.values())
        resources = [resource for module in modules for resource in module.resources.values()]
        if resources:
            resource = resources[a % len(resources)]
            self.request(headers.Unlock, resource.name, resource.module)

    def lose_(self, a: int, *_: int) -> None:
        others = [name for name in self.connections() if name != "user"]
        if others:
            self.player.lose(others[a % len(others)])

    def bye_(self, a: int, *_: int) -> None:
        others = [name for name in self.connections() if name != "user"]
        if others:
            self.player.receive(others[a % len(others)], headers.Bye())

    def unregister_(self, a: int, b: int, *_: int) -> None:
        """Let a module stay connected, but no longer handle one of its messages."""
        if handling := [
            module for module in self.central.registry.modules.values() if module.handlers
        ]:
            module = handling[a % len(handling)]
            messages, name = (
                list(module.handlers),
                next(iter(module.connections.values())).id.decode(),
            )
            self.player.request(name, headers.Unregister, [messages[b % len(messages)]])

    def join_(self, a: int, *_: int) -> None:
        self.join(list(self.modules)[a % len(self.modules)])
