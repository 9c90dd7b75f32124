"""The requests of scripts to central, and its answers; ``play.py`` decides which script runs."""

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from tca_central.core import Central
from tca_central.events import ConnectionId, Effect, Event, Record, RequestReceived
from tca_module.errors import NIL
from tca_tools.check.events import check_event
from tca_tools.check.handling import check_locks
from tca_tools.check.world import JournalWorld
from tca_tools.explore.errors import CentralFault, ScenarioError
from tca_tools.explore.observed.observer import Observer
from tca_tools.explore.observed.world import AcceptedRequest
from tca_tools.explore.play.actors import Actor, ModuleLine, OpenRequest
from tca_tools.explore.play.identifiers import (
    MessageId,
    RequestNumber,
    numbers_shown,
    renamed,
    renamed_rows,
)
from tca_tools.explore.play.inbox import SlotInbox
from tca_tools.explore.scenario import steps
from tca_tools.explore.scenario.requests import call_of
from tca_tools.explore.scenario.scenario import Scenario
from tca_wire.journal.facts import Entry, Fact, Ignored, RequestRefused
from tca_wire.messages.controls import Monitor
from tca_wire.messages.failures import MODULE_LOST
from tca_wire.messages.message import with_needed
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Requested
from tca_wire.points import TaskId

OBSERVER = ConnectionId(b"observer")
"""The connection of the module that observes the states of all tasks."""
_AWAITED, _READ = steps.AwaitAnswer(0).kind, steps.ReadClientRequest().kind


class Exchange:
    """Central, the connections to it, and the scripts that use them."""

    def __init__(self, scenario: Scenario) -> None:
        self.central = Central("explored")
        # Central does not search for deadlocks here: ``never_stuck()`` finds them.
        self.central.search_delay = 0
        self.central.tree.newest = MessageId(0)
        # Every handler counts as quick, because their durations are no part of the state.
        self.central.dispatcher.prefetcher.trusts_all = True
        self.world = JournalWorld([], is_whole=True)
        self.observer: Observer | None = None
        #: The request that central accepted with the last action.
        self.taken: AcceptedRequest | None = None
        self.now = 0.0  #: seconds since the run began
        self.lines: dict[str, ModuleLine] = {}  #: by name: the open connections
        #: By line: a digest of its ended scripts, if a module has a prefetch.
        self.digests: dict[str, bytes] = {}
        self.facts: list[Fact] = []  #: recorded with the last action
        self.scenario = scenario
        self._known = scenario.messages()  #: messages that some module handles
        self._number = RequestNumber(0)

    def next_number(self) -> RequestNumber:
        """Return the number of a new request."""
        self._number += 1
        return self._number

    def receive(self, line: str, header: headers.ToCentral, body: bytes = b"") -> list[Effect]:
        """Let central receive a header from *line*; return the effects."""
        inbox = self.lines[line].inbox if line in self.lines else None
        if inbox is None:
            return self.handle(RequestReceived(self.now, connection_of(line), header, body))
        return [] if inbox.send(header, body) else self.flush(line, inbox)

    def flush(self, line: str, inbox: SlotInbox) -> list[Effect]:
        """Let central receive what the session of a slot sends; return the effects."""
        events = [
            RequestReceived(self.now, connection_of(line), *item) for item in inbox.outgoing()
        ]
        return [effect for event in events for effect in self.handle(event)]

    def handle(self, event: Event) -> list[Effect]:
        """Let central handle an event, and connections receive its packets; return the effects."""
        try:
            effects = self.central.handle(event)
        except Exception as error:
            raise CentralFault(f"central can't handle {event}: {error!r}") from error
        for effect in effects:
            if isinstance(effect, Record):
                self._record(effect.entry)
            else:
                if effect.connection == OBSERVER and self.observer is not None:
                    self.observer.receive(effect.header, effect.body)
                line = self.lines.get(effect.connection.decode())
                if line is not None and line.run.is_alive:
                    self._send(line, effect.header, effect.body)
        return effects

    def _send(self, line: ModuleLine, header: headers.ToModule, body: bytes) -> None:
        if line.inbox is None:
            self._on_packet(line, header, body)
        elif not line.inbox.enqueue(header, body):
            self.receive_packet(line, line.inbox, header, body)

    def receive_packet(
        self, line: ModuleLine, inbox: SlotInbox, header: headers.ToModule, body: bytes
    ) -> None:
        """Let a slot receive a packet from central."""
        if inbox.receive(header, body):
            self._on_packet(line, header, body)
        self.flush(line.name, inbox)

    def _on_packet(self, line: ModuleLine, header: headers.ToModule, body: bytes) -> None:
        if receive := _ON_PACKET.get(type(header)):
            receive(self, line, header, body)

    def return_prefetched(self, line: ModuleLine, inbox: SlotInbox) -> None:
        """Return the prefetched messages of a slot that leaves."""
        if inbox.session.prefetched:
            inbox.session.return_prefetched()
            self.flush(line.name, inbox)

    def inbox_mismatch(self, line: ModuleLine, inbox: SlotInbox) -> str:
        """Return an error if a slot does not have exactly the messages that central has sent it.

        The comparison finds messages that are lost or handled twice. "" means no error.
        """
        present = sorted([actor.delivery for actor in line.actors] + inbox.deliveries)
        sent = sorted(deliveries_given_to(self.central, line.name))
        if present == sent:
            return ""
        with numbers_shown():
            return f"{line.name} has {present}, but central has sent it {sent}"

    def start_next(self, line: ModuleLine, inbox: SlotInbox) -> None:
        """Let a slot start its next prefetched message."""
        header, body = inbox.start_next()
        self._on_delivery(line, header, body)
        line.start(line.delivered[0])
        slot = self.central.registry.connections[connection_of(line.name)]
        assert slot.resource is not None
        # Central learns of the start only with the reply, so the world checks locks now.
        item = self.world.known(header.delivery)
        if item is not None:
            place = self.world.place(slot.module.name, slot.resource.name)
            with numbers_shown():
                check_locks(self.world, item, place)

    def _record(self, entry: Entry) -> None:
        self.facts += entry.facts
        with numbers_shown():
            check_event(self.world, entry)

    # --- steps ------------------------------------------------------------------------------------

    def carry_out(self, line: ModuleLine, actor: Actor) -> None:
        """Carry out the step of an actor."""
        _CARRY_OUT[type(actor.step)](self, line, actor, actor.step)

    def advance(self, line: ModuleLine) -> None:
        """Play the steps that are no action of their own.

        These are waits, reads of answers, and the end of a script that handles nothing.
        """
        while (actor := line.actor) is not None and actor not in line.delivered:
            if actor.step is not None:
                request = actor.awaited
                if request is None or not (request.unread or actor.is_woken_from(request)):
                    return
                actor.read()
                continue
            branches = actor.branches
            if len(branches) != 1 or branches[0].decisions:
                return
            step = branches[0].step
            if isinstance(step, steps.AwaitAnswer | steps.OweReply):
                actor.step = step
                self.carry_out(line, actor)
            elif isinstance(step, steps.NoticeKill):
                actor.notice_end()
                actor.receive(steps.StepResult(step.kind))
            elif isinstance(step, steps.Return) and not actor.delivery:
                self._finish_script(line)
            else:
                return

    def _ask(self, line: ModuleLine, actor: Actor, step: steps.Ask) -> None:
        self._declare(line, step)
        if isinstance(step.header, headers.Lock):
            self._check_lock(step.header)
        header = renamed(step.header, actor.real_id)
        if getattr(header, "origin", 0):
            header = replace(header, origin=actor.delivery)
        if step.is_one_way:
            actor.receive(steps.StepResult(step.kind))
        else:
            header = replace(header, number=self.next_number())
            if step.wants_answer:
                actor.ask(OpenRequest(header.number, header))
                actor.receive(steps.StepResult(step.kind))
            else:
                actor.number = header.number
        if not any(map(_is_refusal, self.receive(line.name, header, step.body))):
            self.taken = AcceptedRequest(line.run.name, call_of(header))

    def _check_lock(self, header: headers.Lock) -> None:
        """Raise ScenarioError for a lock of a resource that no module of the scenario has.

        If a resource is missing only because its module was lost, the scenario has no mistake.
        """
        owners = self.scenario.owners(header.resource)
        if not owners or header.module not in ("", *owners):
            owner = f"module '{header.module}'" if header.module else "the scenario"
            raise ScenarioError(
                f"{owner} has no resource '{header.resource}' that handles something: "
                "lock or reserve an existing one"
            )
        if not header.module and len(owners) > 1:
            raise ScenarioError(
                f"modules {', '.join(owners)} have a resource '{header.resource}': "
                "choose one with module="
            )

    def _declare(self, line: ModuleLine, step: steps.Ask) -> None:
        """Declare the messages of a step that central does not know yet."""
        is_conditional = getattr(step.header, "if_handled", False)
        registry = self.central.registry.messages
        for message in step.declares:
            is_free = message.message_class.fans_out or isinstance(message, Monitor)
            if message.name not in self._known and not (is_free or is_conditional):
                raise ScenarioError(
                    f"{line.run.name} sends {message.message_class} '{message.name}', which no "
                    "module of the scenario handles: add a handler for it"
                )
        formats = [message.format for message in with_needed(step.declares)]
        new = [
            declared
            for declared in formats
            if declared.name not in registry or registry[declared.name].format != declared
        ]
        if new:
            self.receive(line.name, headers.Register(self.next_number(), new))

    def _await(
        self, _line: ModuleLine, actor: Actor, step: steps.AwaitAnswer | steps.ReadClientRequest
    ) -> None:
        actor.times_out_at = None if step.seconds is None else self.now + step.seconds

    def _read_client_request(
        self, line: ModuleLine, actor: Actor, step: steps.ReadClientRequest
    ) -> None:
        """Let a script read a client's request to its task, or wait for one."""
        if actor.client_requests:
            actor.receive(actor.client_requests.popleft())
        elif not step.waits:
            actor.receive(steps.StepResult(step.kind))
        else:
            self._await(line, actor, step)
            actor.wake_from_read()

    def _on_requested(self, line: ModuleLine, header: Requested, body: bytes) -> None:
        got = steps.StepResult(
            _READ, text=header.text, body=body, choice=header.serial, words=header.transition
        )
        for actor in _handlers(line, header.delivery):
            actor.queue_request(got)

    def _abandon(self, line: ModuleLine, actor: Actor, step: steps.Abandon) -> None:
        request = actor.requests.pop(step.request)
        actor.receive(steps.StepResult(step.kind, text=request.taken))
        self.receive(line.name, headers.GiveUp(request.number))

    def _finish_script(self, line: ModuleLine) -> None:
        """Remove the script whose turn it is, since it has ended."""
        actor = line.remove_current()
        if self.scenario.has_prefetch:
            self.digests[line.name] = actor.digest(self.digests.get(line.name))

    def _return(self, line: ModuleLine, actor: Actor, step: steps.Return) -> None:
        self._finish_script(line)
        if actor.delivery:
            self._reply(line, actor, step.body, step.transition)

    def _reply(self, line: ModuleLine, actor: Actor, body: bytes, transition: str = "") -> None:
        """Send the reply of a handler that has returned, as a slot of tca_module does.

        A handler that knew of the end of its module may have done only half of its work, so it
        fails.
        """
        if actor.knows_of_module_end and not actor.is_killed:
            failure = headers.Fail(actor.delivery, MODULE_LOST, "its module ended while it ran")
            self.receive(line.name, failure)
        else:
            reply = headers.Reply(actor.delivery, transition=transition)
            self.receive(line.name, reply, body)

    def _fail(self, line: ModuleLine, actor: Actor, step: steps.Fail) -> None:
        self._finish_script(line)
        if actor.delivery and step.was_killed and (actor.is_killed or actor.is_ending):
            actor.notice_end()
            self._reply(line, actor, NIL)
        elif actor.delivery:
            header = headers.Fail(
                actor.delivery, step.failure, step.text, list(step.kinds), step.reissue
            )
            self.receive(line.name, header, step.body)
        elif not line.run.is_joined:
            raise ScenarioError(f"this error ends the module: {step.failure}: {step.text}")

    def _use_kept(self, line: ModuleLine, actor: Actor, step: steps.UseKeptReplies) -> None:
        """Pass *step* to the handlers' scripts, which use their replies later."""
        lines = line.run.lines
        for handler in [actor for each in lines for actor in (*each.stack, *each.owing)]:
            if handler.program is line.run.module.handlers.get(step.message):
                handler.use_reply(step.words)
        actor.receive(steps.StepResult(step.kind))

    def _owe_reply(self, line: ModuleLine, actor: Actor, step: steps.OweReply) -> None:
        """Let a handler return that replies later. Other scripts may use its thread."""
        if actor in line.stack:
            line.stack.remove(actor)
            line.owing.append(actor)
            self.receive(line.name, headers.Postpone(actor.delivery, step.frees_slot))
        actor.use_reply()

    def _hang(self, _line: ModuleLine, _actor: Actor, _step: steps.Hang) -> None:
        """Do nothing: this step never has a result."""

    # --- answers ----------------------------------------------------------------------------------

    def _on_delivery(self, line: ModuleLine, header: headers.Deliver, body: bytes) -> None:
        program = line.run.module.handlers[header.message]
        accepts = any(
            handler.accepts
            for handler in line.run.module.formats
            if handler.message == header.message
        )
        given = steps.HandlerInput(body, bool(header.task), accepts)
        actor = Actor(program, given, header.delivery, header.task)
        context = renamed(header.context, actor.script_name)
        actor.script_run = program.start(replace(given, context=context))
        actor.suspended = (header.suspended,)
        if line.run.is_leaving:
            actor.request_end(module_ends=True)
        line.delivered.append(actor)

    def _on_accepted(self, line: ModuleLine, header: headers.Accepted, _: bytes) -> None:
        actor = _asking(line, header.number)
        if actor is not None and isinstance(actor.step, steps.Ask):
            # In the reply to a change of state, ``id`` is the number of changes, not an id.
            is_change = isinstance(actor.step.header, ChangeState)
            created = TaskId(bool(header.id)) if is_change else actor.script_name(header.id)
            actor.receive(steps.StepResult(actor.step.kind, id=created))
        self._answer(line, header.number, steps.StepResult(_AWAITED, id=TaskId(0)))

    def _on_refused(self, line: ModuleLine, header: headers.Refused, _: bytes) -> None:
        refusal = header.refusal, header.text
        if (actor := _asking(line, header.number)) is not None and actor.step is not None:
            actor.receive(steps.StepResult(actor.step.kind, *refusal))
            return
        is_awaited = self._answer(line, header.number, steps.StepResult(_AWAITED, *refusal))
        if header.number and not is_awaited:
            raise ScenarioError(f"{line.run.name}: {header.text}")

    def _on_answer(self, line: ModuleLine, header: headers.Answer, body: bytes) -> None:
        got = steps.StepResult(_AWAITED, answer=replace(header, number=0), body=body)
        self._answer(line, header.number, got)

    def _answer(self, line: ModuleLine, number: int, got: steps.StepResult) -> bool:
        """Queue an answer for the actor that awaits it; return whether there is one."""
        for actor, request in _requests(line, number):
            if not request.is_over:
                if isinstance(request.header, headers.Inspect) and got.body:
                    got = replace(got, body=renamed_rows(got.body, actor.script_name))
                request.unread.append(got)
                request.is_over = got.is_over
                return True
        return False

    def _on_cancelled(self, line: ModuleLine, header: headers.Cancelled, _: bytes) -> None:
        for actor in _handlers(line, header.delivery):
            actor.request_end()

    def _on_taken(self, line: ModuleLine, header: headers.Taken, _: bytes) -> None:
        for _actor, request in _requests(line, header.number):
            request.taken = header.text

    def _on_suspended(self, line: ModuleLine, header: headers.Suspended, _: bytes) -> None:
        for actor in _handlers(line, header.delivery):
            actor.suspended = (*actor.suspended, header.is_suspended)


def _asking(line: ModuleLine, number: int) -> Actor | None:
    """Return the actor that waits for central's reply to the request of that number."""
    return next((actor for actor in line.actors if number and actor.number == number), None)


def _handlers(line: ModuleLine, delivery: int) -> list[Actor]:
    return [actor for actor in line.actors if actor.delivery == delivery]


def _requests(line: ModuleLine, number: int) -> list[tuple[Actor, OpenRequest]]:
    return [
        (actor, request)
        for actor in line.actors
        for request in actor.requests.values()
        if request.number == number
    ]


def connection_of(name: str) -> ConnectionId:
    """Return central's id of the line with that name."""
    return ConnectionId(name.encode())


def deliveries_given_to(central: Central, line: str) -> list[int]:
    """Return the deliveries that central has sent to a slot and that are not over."""
    slot = central.registry.connections[connection_of(line)]
    prefetched = (
        slot.resource.prefetched
        if slot.resource is not None and slot.resource.prefetching_slot is slot
        else ()
    )
    return [delivery.handling_id for delivery in (*slot.handling, *prefetched)]


def _is_refusal(effect: Effect) -> bool:
    """Whether central refuses a request, or records that it came too late to change anything."""
    facts = effect.entry.facts if isinstance(effect, Record) else ()
    return any(isinstance(fact, Ignored | RequestRefused) for fact in facts)


# ruff: noqa: SLF001
_CARRY_OUT: dict[type, Callable[[Exchange, ModuleLine, Actor, Any], None]] = {
    steps.Ask: Exchange._ask,
    steps.AwaitAnswer: Exchange._await,
    steps.ReadClientRequest: Exchange._read_client_request,
    steps.Abandon: Exchange._abandon,
    steps.Return: Exchange._return,
    steps.Fail: Exchange._fail,
    steps.Hang: Exchange._hang,
    steps.OweReply: Exchange._owe_reply,
    steps.UseKeptReplies: Exchange._use_kept,
}
_ON_PACKET: dict[type, Callable[[Exchange, ModuleLine, Any, bytes], None]] = {
    headers.Deliver: Exchange._on_delivery,
    Requested: Exchange._on_requested,
    headers.Accepted: Exchange._on_accepted,
    headers.Refused: Exchange._on_refused,
    headers.Answer: Exchange._on_answer,
    headers.Cancelled: Exchange._on_cancelled,
    headers.Suspended: Exchange._on_suspended,
    headers.Taken: Exchange._on_taken,
}
