"""A reference scheduler: a second central that is simple, slow and, one hopes, obviously right.

It is written from the semantics and docs/decisions, and shares no rule with tca_central: it has no
agendas, counters, heaps or tickets. Tasks are plain records, constraints a list of pairs of points,
timers a list of times.

The oracle gets the same events as central. After each event the oracle tries every rule on every
task until no rule changes anything: then all points are reached that may be. Next, the oracle
determines which tasks and messages may start, and which one is next at each resource. Central must
have reached the same points and answered the same waits. Central must also have delivered in the
order of priority and arrival, and sent nothing else.

The rules leave some choices open: ids of messages that central makes, the order of equal arrivals,
and the slot. The oracle takes these choices from central (``Seen``). The oracle also accepts each
deadlock that central reports; test_deadlocks.py judges deadlocks. If central refuses a request, the
oracle does not judge the refusal, and changes nothing.

Lives for the oracle have no variables and no pending limits; transcripts/pending_limits.txt holds
the rules of displacement. No two timers are due at the same time.

    oracle.py           the effect of each message.
    oracle_rules.py     points, constraints, birth and end of tasks.
    oracle_records.py   the records.
    oracle_failures.py  failures, retries, kills, suspension.
    oracle_policies.py  retry policies.
    oracle_slots.py     resources and their order.
    oracle_lending.py   slots that are lent.
    oracle_locks.py     locks and reservations.
    oracle_taps.py      wiretaps.
    oracle_monitors.py  monitors.
    oracle_states.py    the states of tasks, judged on their own.
"""

from collections.abc import Callable
from typing import Any

from properties import (
    oracle_failures,
    oracle_locks,
    oracle_monitors,
    oracle_policies,
    oracle_rules,
    oracle_slots,
    oracle_taps,
)
from properties.oracle_records import (
    EA,
    Attachment,
    Collector,
    Disagreement,
    Ending,
    Handler,
    Job,
    Node,
    Seen,
    Wait,
    World,
)

from tca_central.events import ConnectionLost, Effect, Event, RequestReceived
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.points import THIS, Moment
from tca_wire.vocabulary import Condition, MessageClass, Role

LOST = ("module lost",)
STEPS = (
    oracle_monitors.go_on,
    oracle_failures.skip_stranded,
    oracle_monitors.start_all,
    oracle_rules.begin_attempts,
    oracle_slots.give,
    oracle_locks.end_deadlocks,
)


class Oracle:
    """A judge of central. It raises Disagreement if central's effects for an event differ from the
    oracle's own.
    """

    def __init__(self) -> None:
        self.world = World()
        self.reached: dict[int, int] = {}  # moments, by living task, according to central
        self.claimed: dict[int, bool] = {}  # by claim: whether it is granted, according to central
        self.queued: dict[int, int] = {}  # by delivery: the queued message, according to central

    def judge(self, event: Event, effects: list[Effect]) -> None:
        world = self.world
        seen = world.seen = Seen(effects)
        world.time = max(world.time, event.time)
        world.step += 1
        world.retried = []
        if isinstance(event, RequestReceived):
            world.unread = event.connection.decode(), getattr(event.header, "number", 0)
        oracle_rules.pass_time(world, self._settle)
        world.unread = "", 0
        if isinstance(event, ConnectionLost):
            self._leave(event.connection.decode(), lost=True)
        elif (
            isinstance(event, RequestReceived)
            and not seen.is_refused
            and type(event.header) in MESSAGES
        ):
            MESSAGES[type(event.header)](self, event.connection.decode(), event.header, event.body)
        self._settle()
        self._compare(seen)

    def _settle(self) -> None:
        oracle_rules.settle(self.world)
        while any(step(self.world) for step in STEPS):
            oracle_rules.settle(self.world)

    def _compare(self, seen: Seen) -> None:
        """Compare the points, deliveries, waits and claims of central with those of the oracle."""
        world = self.world
        for fact in seen.facts:
            if isinstance(fact, facts.Reached):
                self.reached[fact.task] = self.reached.get(fact.task, 0) | fact.moments
        for task in world.nodes:
            ours, theirs = sum(world.nodes[task].past), self.reached.setdefault(task, 0)
            if ours != theirs:
                raise Disagreement(
                    f"task {task} has reached {_words(ours)}; central says {_words(theirs)}"
                )
        for task in self.reached.keys() - world.nodes.keys():
            if (theirs := self.reached.pop(task)) != 63:
                raise Disagreement(f"task {task} has ended; central says {_words(theirs)}")
        if world.seen.made or world.seen.given:
            raise Disagreement(
                f"central sent or delivered more: {world.seen.made} {world.seen.given}"
            )
        if world.retried != seen.retried:
            raise Disagreement(f"policies retry {world.retried}; central says {seen.retried}")
        self._compare_queues(seen)
        self._compare_waits(seen)
        self._compare_claims(seen)

    def _compare_queues(self, seen: Seen) -> None:
        """Compare the tasks that wait for a slot."""
        for fact in seen.facts:
            if isinstance(fact, facts.Queued):
                self.queued[fact.id] = fact.message_id
            elif isinstance(fact, facts.Unqueued | facts.Delivered):
                self.queued.pop(fact.id, None)
        ours = {node.id for node in self.world.nodes.values() if node.waiting}
        theirs = self.world.nodes.keys() & self.queued.values()
        if ours != theirs:
            raise Disagreement(f"tasks that wait for a slot: {ours}; central says {theirs}")

    def _compare_waits(self, seen: Seen) -> None:
        world = self.world
        answered = {
            (name, header.number)
            for name, header in seen.transmitted
            if isinstance(header, headers.Answer)
        }
        for key, wait in list(world.waits.items()):
            node, moment = wait.node, wait.moment
            if (moment in node.past) != (key in answered):
                raise Disagreement(
                    f"{key} waits for {moment} of {node.id}: answered {key in answered}"
                )
            if moment in node.past:
                del world.waits[key]

    def _compare_claims(self, seen: Seen) -> None:
        """Compare the granted and pending claims, and the answers to the granted ones."""
        for fact in seen.facts:
            if isinstance(fact, facts.Claimed | facts.Granted):
                self.claimed[fact.id] = isinstance(fact, facts.Granted)
            elif isinstance(fact, facts.ClaimEnded):
                del self.claimed[fact.id]
        ours = {claim.id: claim.granted for claim in self.world.claims}
        if ours != self.claimed:
            raise Disagreement(f"claims (True: granted): {ours}; central says {self.claimed}")
        answered = {
            (name, header.number)
            for name, header in seen.transmitted
            if isinstance(header, headers.Answer)
        }
        granted = {fact.id for fact in seen.facts if isinstance(fact, facts.Granted)}
        for claim in self.world.claims:
            if (claim.id in granted) != ((claim.sender, claim.number) in answered):
                raise Disagreement(
                    f"{claim}: granted {claim.id in granted}, but its sender has another answer"
                )

    # --- modules ----------------------------------------------------------------------------------

    def hello(self, connection: str, header: headers.Hello, _: bytes) -> None:
        self.world.modules[connection] = header.module
        if header.resource:
            self.world.slots[connection] = (header.module, header.resource)

    def register(self, connection: str, header: headers.Register, _: bytes) -> None:
        world = self.world
        for declared in header.messages:
            world.kinds[declared.name] = declared.message_class
            world.parts[declared.name] = declared.parts
        for handled in header.handlers:
            module = world.modules[connection]
            oracle_slots.remove_handler(world, handled.message, module)
            handlers = world.handlers.setdefault(handled.message, [])
            handlers.append(Handler(module, handled.resource, handled.pool))

    def unregister(self, connection: str, header: headers.Unregister, _: bytes) -> None:
        for name in header.messages:
            oracle_slots.remove_handler(self.world, name, self.world.modules[connection])

    def bye(self, connection: str, _: headers.Bye, _body: bytes) -> None:
        self._leave(connection, lost=False)

    def _leave(self, connection: str, *, lost: bool) -> None:
        if connection not in self.world.modules:
            return
        for job in oracle_slots.leave(self.world, connection, lost=lost):
            oracle_taps.left(self.world, job, lost=lost)
            if not isinstance(job, Node):
                self._orphaned(job, lost=lost)
            elif lost or job.killed:
                oracle_failures.returned_with_failure(self.world, job, LOST)
            else:
                job.wanted = True

    def _orphaned(self, job: Job, *, lost: bool) -> None:
        if lost or job.target:
            oracle_slots.answered(self.world, job, done=False)
            oracle_monitors.answered(self.world, job, None)
        else:
            oracle_slots.wait(self.world, job)

    def _checked_origin(self, connection: str, origin: int) -> int:
        """Return *origin*, the delivery whose handler sent the request; 0 if that handler runs in
        another module.
        """
        modules = self.world.modules
        owners = [
            modules[job.slot]
            for job in self.world.everything()
            if job.slot and job.handling_id == origin
        ]
        return 0 if owners and modules[connection] not in owners else origin

    # --- sending ----------------------------------------------------------------------------------

    def send(self, connection: str, header: headers.Send, body: bytes) -> None:
        """Send a message that central has accepted. Central has assigned an id, except to a
        termination message and to an *if handled* message without a handler.
        """
        world = self.world
        kind = world.kinds[header.message]
        if header.when_killed and kind.is_task and world.seen.is_accepted_as(0):
            if not (header.if_handled and not oracle_slots.is_served(world, header.message)):
                parent = world.node(header.parent)
                assert parent
                if parent.killed:
                    oracle_rules.make(world, header.message, Role.TERMINATION, parent, parent)
                else:
                    parent.termination_messages.append(header.message)
            return
        if header.if_handled and not oracle_slots.is_served(world, header.message):
            return
        (birth,) = world.seen.sent
        if kind.is_task:
            self._new_task(connection, header, birth.id)
            return
        module = world.modules[connection]
        job = Job(
            birth.id, header.message, kind, connection, module, header.number, header.priority
        )
        job.origin = self._checked_origin(connection, header.origin)
        oracle_taps.happened(world, job, {Condition.WHEN_SENT})
        if kind is MessageClass.MULTI_QUERY:
            pending = oracle_slots.copies(world, job)
            wanted = min(header.maximum or len(pending), len(pending))
            if pending:
                world.collectors.append(Collector(connection, header.number, wanted, pending))
        elif kind is MessageClass.QUERY:
            oracle_slots.wait(world, job)
        else:
            oracle_slots.send_statement(world, job)

    def _new_task(self, connection: str, header: headers.Send, task: int) -> None:
        world = self.world
        parent = world.node(header.parent)
        assert parent is not None
        kind = world.kinds[header.message]
        module = world.modules[connection]
        node = Node(
            task,
            header.message,
            kind,
            connection,
            module,
            priority=header.priority,
            run=world.ended_runs[module],
        )
        if header.retry is not None:
            node.policy = oracle_policies.Policy(header.retry)
        if kind.is_monitor:
            oracle_monitors.init_watch(node, header.watch)
            node.is_foreign = oracle_monitors.is_foreign(
                world, parent, self._checked_origin(connection, header.origin)
            )
        oracle_rules.add(world, node, parent)
        last = world.last.get(oracle_rules.family(node))
        for one, other in oracle_rules.from_flags(header.flags, node, last):
            if other[1] not in node.past:
                oracle_rules.constrain(world, one, other, 0)
        for wanted in header.constraints:
            self._constrain(wanted, this=task)
        if node.is_eligible:
            world.last[oracle_rules.family(node)] = node
        oracle_taps.happened(world, node, {Condition.WHEN_SENT})
        if header.suspended and not node.killed:
            oracle_failures.suspend(world, node, resume=False)
        for attachment in header.attachments:
            self._attach(attachment, node, node.module)
        if header.deadline:
            oracle_rules.set_alarm(world, header.deadline, node, moment=EA)

    def _constrain(self, wanted: Any, this: int = 0) -> None:
        one, other = (
            oracle_rules.place(self.world, this if at.task == THIS else at.task, Moment(at.moment))
            for at in (wanted.before, wanted.after)
        )
        is_void = oracle_rules.never_begins(self.world, wanted.before.task, wanted.before.moment)
        delay = 0 if is_void else wanted.delay
        if delay or not oracle_rules.is_past(one):
            if oracle_rules.never_begins(self.world, wanted.after.task, wanted.after.moment):
                return
            if other is None or oracle_rules.is_past(other):
                raise Disagreement(f"central takes {wanted}, though {wanted.after} is past")
            oracle_rules.constrain(self.world, one, other, delay)

    # --- handlers return --------------------------------------------------------------------------

    def _returned(self, handling_id: int) -> Job:
        (job,) = (
            job for job in self.world.everything() if job.slot and job.handling_id == handling_id
        )
        oracle_slots.leave_slot(job)
        return job

    def replies(self, connection: str, header: headers.Replies, body: bytes) -> None:
        """Apply several replies in turn. Each later run started when the run before it returned."""
        at = 0
        for run in header.ended:
            if at:
                oracle_slots.give_messages(self.world)
            self.reply(connection, headers.Reply(run.delivery), body[at : at + run.size])
            at += run.size

    def reply(self, _: str, header: headers.Reply, body: bytes) -> None:
        job = self._returned(header.delivery)
        oracle_taps.happened(self.world, job, oracle_taps.after_handler(job.kind, failed=False))
        if job.killed if isinstance(job, Node) else True:
            oracle_locks.end_for(self.world, job)
        if not isinstance(job, Node):
            oracle_slots.answered(self.world, job, done=True)
            oracle_monitors.answered(self.world, job, body)
        elif job.again and not job.killed:
            oracle_failures.retry(self.world, job)
        else:
            job.returned = True
            oracle_locks.raise_lock_lost(self.world, job)

    def postpone(self, _: str, header: headers.Postpone, _body: bytes) -> None:
        (job,) = (
            job
            for job in self.world.everything()
            if job.slot and job.handling_id == header.delivery
        )
        if not job.is_postponed:
            job.is_postponed, job.frees_slot = True, header.frees_slot

    def fail(self, _: str, header: headers.Fail, _body: bytes) -> None:
        job = self._returned(header.delivery)
        oracle_taps.happened(
            self.world,
            job,
            oracle_taps.after_handler(job.kind, failed=True, reissued=header.reissue),
        )
        oracle_locks.end_for(self.world, job)
        if not isinstance(job, Node):
            oracle_slots.answered(self.world, job, done=False)
            oracle_monitors.answered(self.world, job, None, (header.failure, *header.kinds))
        elif header.reissue and not job.again and not job.killed:
            oracle_failures.reissue(self.world, job)
        else:
            oracle_failures.returned_with_failure(self.world, job, (header.failure, *header.kinds))

    # --- steering ---------------------------------------------------------------------------------

    def constrain(self, _: str, header: headers.Constrain, _body: bytes) -> None:
        for wanted in header.constraints:
            self._constrain(wanted)

    def wait_for(self, connection: str, header: headers.AwaitPoint, _: bytes) -> None:
        node = self.world.nodes.get(header.point.task)
        if node is not None:
            wait = Wait(node, Moment(header.point.moment), header.origin)
            wait.holds_back = header.origin if header.blocking or header.lends_slot else 0
            self.world.waits[connection, header.number] = wait

    def await_(self, connection: str, header: headers.Await, _: bytes) -> None:
        wait = self.world.waits.get((connection, header.request))
        if wait is not None and header.blocking and not header.others and header.seen >= 0:
            wait.holds_back = wait.origin

    def await_any(self, connection: str, header: headers.AwaitAny, _: bytes) -> None:
        (request,) = header.requests  # the lives wait for one
        for (sender, number), wait in self.world.waits.items():
            if sender == connection and number == request:
                wait.coroutine = header.delivery
            elif sender == connection and wait.coroutine == header.delivery:
                wait.coroutine = 0

    def give_up(self, connection: str, header: headers.GiveUp, _: bytes) -> None:
        oracle_slots.give_up(self.world, connection, header.request)

    def kill(self, _: str, header: headers.Kill, _body: bytes) -> None:
        if (node := self.world.node(header.task)) is None:
            return
        at = header.after
        after = oracle_rules.place(self.world, at.task, at.moment) if at is not None else None
        ending = Ending(node, header.scope, header.delay, after)
        if oracle_rules.is_past(after):
            oracle_failures.end(self.world, ending)
        else:
            self.world.endings.append(ending)

    def attach(self, connection: str, header: headers.Attach, _: bytes) -> None:
        self._attach(
            header.attachment,
            header.message or self.world.node(header.task),
            self.world.modules[connection],
        )

    def _attach(self, wanted: Any, where: Any, by: str) -> None:
        world = self.world
        attached = (
            where.attached if isinstance(where, Node) else world.attached.setdefault(where, [])
        )
        same = (wanted.failure, wanted.handler, by)
        attached[:] = [one for one in attached if (one.failure, one.handler, one.by) != same]
        number = world.seen.attached.pop(0).id
        message = "" if isinstance(where, Node) else where
        attached.append(
            Attachment(number, wanted.failure, wanted.handler, wanted.maximum, message, by)
        )

    def remove(self, connection: str, header: headers.Remove, _: bytes) -> None:
        world = self.world
        for attached in [
            *world.attached.values(),
            *(node.attached for node in [world.root, *world.nodes.values()]),
        ]:
            attached[:] = [one for one in attached if one.id != header.id]
        oracle_taps.remove_holder(
            world, header.id, world.modules[connection], for_all=header.for_all
        )
        if header.for_all and header.id in world.nodes:
            oracle_monitors.end(world, world.nodes[header.id])

    def raise_(self, _: str, header: headers.Raise, _body: bytes) -> None:
        if (node := self._unkilled(header.task)) is not None:
            oracle_failures.raise_beside(self.world, node, (header.failure, *header.kinds))

    def retry(self, connection: str, header: headers.Retry, _body: bytes) -> None:
        if (node := self._unkilled(header.task)) is not None:
            oracle_failures.retry_now(self.world, node, connection)

    def resolve(self, _: str, header: headers.Resolve, _body: bytes) -> None:
        node = next(
            (
                one
                for one in self.world.nodes.values()
                if one.slot and one.handling_id == header.origin
            ),
            None,
        )
        if node is not None and node.role is Role.EXCEPTION:
            oracle_failures.resolve(node)

    def _unkilled(self, task: int) -> Node | None:
        """Return a living task that is not killed; None otherwise."""
        node = self.world.nodes.get(task)
        return node if node is not None and not node.killed else None

    def suspend(self, _: str, header: headers.Suspend, _body: bytes) -> None:
        if (node := self.world.nodes.get(header.task)) is not None:
            oracle_failures.suspend(self.world, node, resume=header.resume)

    def deadline(self, _: str, header: headers.Deadline, _body: bytes) -> None:
        node, moment = self._unkilled(header.point.task), Moment(header.point.moment)
        if node is not None and moment not in node.past:
            oracle_rules.set_alarm(self.world, header.seconds, node, moment=moment)

    def fire(self, _: str, header: headers.Fire, _body: bytes) -> None:
        named = [
            node
            for node in self.world.nodes.values()
            if node.watch and node.message == header.message
        ]
        if not header.message:
            named = [node for number, node in self.world.nodes.items() if number == header.monitor]
        for node in named:
            if node.watch.is_on:
                oracle_monitors.activate(self.world, node)

    def end_monitor(self, _: str, header: headers.EndMonitor, _body: bytes) -> None:
        if (node := self.world.nodes.get(header.monitor)) is not None:
            oracle_monitors.end(self.world, node)

    def lock(self, connection: str, header: headers.Lock, _: bytes) -> None:
        oracle_locks.lock(self.world, connection, header)

    def unlock(self, _: str, header: headers.Unlock, _body: bytes) -> None:
        oracle_locks.unlock(self.world, header)

    def tap(self, connection: str, header: headers.Tap, _: bytes) -> None:
        world, module = self.world, self.world.modules[connection]
        oracle_taps.tap(world, module, header)


def _words(moments: int) -> str:
    return ", ".join(str(moment.name) for moment in Moment if moment & moments) or "nothing"


MESSAGES: dict[type, Callable[[Oracle, str, Any, bytes], None]] = {
    headers.Hello: Oracle.hello,
    headers.Register: Oracle.register,
    headers.Unregister: Oracle.unregister,
    headers.Bye: Oracle.bye,
    headers.Send: Oracle.send,
    headers.Reply: Oracle.reply,
    headers.Replies: Oracle.replies,
    headers.Fail: Oracle.fail,
    headers.Constrain: Oracle.constrain,
    headers.AwaitPoint: Oracle.wait_for,
    headers.Await: Oracle.await_,
    headers.AwaitAny: Oracle.await_any,
    headers.Postpone: Oracle.postpone,
    headers.GiveUp: Oracle.give_up,
    headers.Kill: Oracle.kill,
    headers.Attach: Oracle.attach,
    headers.Remove: Oracle.remove,
    headers.Raise: Oracle.raise_,
    headers.Retry: Oracle.retry,
    headers.Resolve: Oracle.resolve,
    headers.Suspend: Oracle.suspend,
    headers.Deadline: Oracle.deadline,
    headers.Lock: Oracle.lock,
    headers.Unlock: Oracle.unlock,
    headers.Tap: Oracle.tap,
    headers.Fire: Oracle.fire,
    headers.EndMonitor: Oracle.end_monitor,
}
"""The method for each header that the oracle judges."""
