"""Clients and servers take transitions of a task's life cycle. Central decides conflicts.

Theory of operation (Lütkebohle et al., 4.5.1). The server is dominant. Each change of a task's
state gets the next serial number. A request names the last number that its sender has seen. A
request that names a higher number than the task's last one is refused.

If a client has not seen a change by the server, the client's request is applied after that change.
If the table has no such transition in the new state, the request is ignored. If the server has not
seen a change by a client, the server's request is applied as if it had come first. Then the
client's request is applied once more, where the table allows that. The handler was notified of the
client's request before, and is not notified again.

A handler may declare that it takes a transition. Then the handler decides about clients' requests
for this transition. Otherwise the defaults decide. An update kills the tasks under the task, which
is then handled again with the new goal. A cancel kills the task.
"""

from msgspec.structs import replace

from tca_central.errors import RequestError
from tca_central.failing.failures import kill, retry_task
from tca_central.failing.retry_order import check_order
from tca_central.model.deliveries import Connection, Delivery, Handler, Module
from tca_central.model.tasks import ClientRequest, Clients, Task, Verdict
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.life_cycles import Effect, LifeCycle, Transition, read_life_cycle
from tca_wire.packets.changes import ChangeState, Requested
from tca_wire.packets.large import held_size
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.text.printable import shortened
from tca_wire.vocabulary import CENTRAL, Busy, Party, Refusal

MOST_ASKED = 32
"""Requests of clients that may wait for the decision of a task's handler."""


def check_custom_handler(handled: HandlerFormat, declared: MessageFormat) -> None:
    """Raise RequestError if a handler takes or refuses transitions that clients do not have."""
    wishes = (*handled.takes, *handled.refuses)
    if not declared.message_class.is_task:
        if wishes or handled.accepts or handled.busy is not Busy.QUEUE:
            what = f"{declared.message_class} '{declared.name}'"
            text = f"{what} is not a task: its handler accepts and takes nothing"
            raise RequestError(Refusal.PROTOCOL, text)
        return
    cycle = read_life_cycle(declared.life_cycle)
    names = cycle.names(Party.CLIENT)
    for name in wishes:
        if name not in names:
            what = f"the handler of '{declared.name}' can't take '{name}'"
            text = f"{what}: clients take {_listed(names)}"
            raise RequestError(Refusal.PROTOCOL, text)
    for row in cycle.transitions if handled.refuses else ():
        is_refused = row.name in handled.refuses and row.by is Party.CLIENT
        if is_refused and cycle.ends_on_request(row.target) and not cycle.refusal(row.target):
            what = f"the handler of '{declared.name}' can't refuse '{row.name}'"
            raise RequestError(Refusal.PROTOCOL, f"{what}: {cycle.why_no_refusal(row.target)}")


def restart(central: State, task: Task, *, is_replaced: bool = False) -> None:
    """Set a task back to its initial state for its next handler.

    If a client has requested the end of the task, kill the task instead. If the fallback of its
    retry policy replaces the task now, the task has no next handler, and keeps its state.
    """
    asked = central.tree.pop_client_requests(task)
    if task.clients is not None:
        task.clients.newest = 0  # the next handler has not been sent any requests
        task.clients.ending = ""
    if task.message.life_cycle.ends_on_request(task.state):
        kill(central, task, _wanted_by(asked, CENTRAL))
    elif task.state != task.message.initial_state and not is_replaced:
        task.state = task.message.initial_state
        task.serial += 1
        central.notify_observers(task, "restarted", Party.CENTRAL)


def on_change_state(
    central: State, connection: Connection, header: ChangeState, body: bytes
) -> None:
    """Change a task's state at the request of a client, or of its handler."""
    task = central.living_task_or_ignore(
        connection, header.number, header.task, f"it can't take '{header.transition}'"
    )
    if task is None:
        return
    if header.serial > task.serial:
        text = (
            f"{task} has changed {task.serial} times, and the request names change "
            f"{header.serial}: observe the task again"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    central.check_room(held_size(body))
    header = replace(header, text=shortened(header.text))
    asking = central.dispatcher.running.get(central.origin)
    if asking is task:
        _change_by_server(central, connection, header, body, task)
    else:
        _change_by_client(central, connection, header, body, task)


def set_ending(central: State, delivery: Delivery, transition: str) -> str:
    """Store the transition by which the handler that has returned ends its task ("": the usual).

    Return why the task can't end in this way; "" if it can. If only a client's request to end the
    task is left to be followed, kill the task.
    """
    if not isinstance(delivery, Task) or not (transition or delivery.message.format.life_cycle):
        return ""
    task, cycle = delivery, delivery.message.life_cycle
    if task.killed or task.retry_pending:
        return ""
    # The server is dominant: its end may come before requests that it has not seen.
    asked = task.clients.asked if task.clients is not None else []
    step = cycle.completion([task.state, *(one.source for one in asked)], transition)
    if step is not None:
        if transition or step.source != task.state:
            Clients.of(task).ending = step.name
        if transition:
            central.tree.pop_client_requests(task)
        return ""
    if not transition and cycle.ends_on_request(task.state):
        kill(central, task, _wanted_by(asked, CENTRAL))
        return ""
    what = f"can't end by '{transition}'" if transition else "can't end as done"
    return f"{task} is '{task.state}': in this state its handler {what}, by {cycle}"


# --- changes by a client --------------------------------------------------------------------------


def _change_by_client(
    central: State, connection: Connection, header: ChangeState, body: bytes, task: Task
) -> None:
    """Apply a transition that a client requests. Raises RequestError if it is not possible now."""
    cycle, name = task.message.life_cycle, header.transition
    step = cycle.step(task.state, name, Party.CLIENT)
    if step is None:
        _check_known(task, name, Party.CLIENT)
        pending = cycle.grant(task.state) and cycle.is_pending(task.state, name)
        if -1 < header.serial < task.serial and not pending:  # the server was first
            central.ignore(connection, header.number, _too_late(task, name))
            return
        raise RequestError(Refusal.TOO_LATE, _not_now(task, name, Party.CLIENT))
    if body and step.effect is not Effect.NEW_GOAL:
        raise RequestError(Refusal.PROTOCOL, f"'{name}' of {task} has no data")
    if task.clients is not None and len(task.clients.asked) >= MOST_ASKED:
        central.tree.pop_client_requests(
            task, lambda one: not _awaits_decision(task, one.source, one.name)
        )
        if len(task.clients.asked) >= MOST_ASKED:
            raise RequestError(
                Refusal.OVERLOAD, f"{MOST_ASKED} requests wait for the handler of {task} already"
            )
    number = task.serial + 1  # later answers to the request refer to this change
    apply_client_request(central, task, step, connection.module.name, header.text, body)
    central.accept(connection, header.number, number)


def apply_client_request(
    central: State, task: Task, step: Transition, module: str, text: str, body: bytes = b""
) -> None:
    """Apply a client's transition. Then the handler decides about it, or else the defaults do."""
    handler = task.handler
    needs_decision = handler is not None and step.name in handler.takes
    if not (needs_decision or _awaits_decision(task, task.state, step.name)):
        raise RequestError(
            Refusal.PROTOCOL, f"no handler of {task} takes '{step.name}': see takes="
        )
    source = task.state
    _apply_step(central, task, step, Party.CLIENT, module, text, body, request=task.serial + 1)
    asked = ClientRequest(step.name, source, task.serial, module, text, body, needs_decision)
    central.tree.ask(task, asked)
    if needs_decision:
        _notify_handler(central, task, asked)
    else:
        _decide(central, task, step, asked, central.origin)


def cancel_tasks_of(central: State, module: Module) -> None:
    """Request the cancel of the living top-level tasks of a module that leaves.

    A task whose state has no transition to its end is killed.
    """
    why = f"module '{module.name}' left"
    for task in list(central.tree.top_of_module.get(module, {}).values()):
        step = task.message.life_cycle.cancel(task.state)
        if task.killed or task.message.life_cycle.ends_on_request(task.state):
            continue
        if step is not None:
            try:
                apply_client_request(central, task, step, module.name, why)
                continue
            except RequestError:  # no handler takes that transition
                pass
        kill(central, task, Verdict(why, module.name))


def apply_defaults(central: State, task: Task) -> None:
    """Decide about clients' requests if a handler has returned without a decision about them."""
    asked = [
        one
        for one in central.tree.pop_client_requests(task)
        if _awaits_decision(task, one.source, one.name)
    ]
    if asked and not task.killed and central.tree.task(task.id) is task:
        cycle, newest = task.message.life_cycle, asked[-1]
        step = cycle.steps[newest.source, newest.name]
        if task.state == step.target:
            _decide(central, task, step, newest, 0)


def _awaits_decision(task: Task, source: str, name: str) -> bool:
    """Whether a client's transition from *source* needs a decision by the handler or central."""
    cycle = task.message.life_cycle
    target = cycle.steps[source, name].target
    return bool(cycle.refusal(target) or cycle.grant(target) or cycle.ends_on_request(target))


def _notify_handler(central: State, task: Task, asked: ClientRequest) -> None:
    """Send a client's request to the handler that has the task."""
    assert task.slot is not None
    header = Requested(task.handling_id, asked.name, asked.serial, asked.text)
    central.notify(task.slot, header, asked.body)


def resend_requests(central: State, task: Task) -> None:
    """Send a handler the clients' requests again, since the handler may have missed them."""
    for asked in task.clients.asked if task.clients is not None else ():
        if asked.needs_decision:
            _notify_handler(central, task, asked)


def _decide(
    central: State, task: Task, step: Transition, asked: ClientRequest, origin: int
) -> None:
    """Decide about a client's request by the defaults, since no handler decides."""
    if why := _refusal_reason(central, task, step, asked.source):
        refusal = task.message.life_cycle.refusal(task.state)
        central.tree.pop_client_requests(task)
        if refusal is not None:
            _apply_step(central, task, refusal, Party.CENTRAL, "", why, request=asked.serial)
    elif step.effect is Effect.NEW_GOAL:
        _accept_goal(central, task, asked)
        retry_task(central, task, asked.body, asked.module)
    elif task.message.life_cycle.ends_on_request(task.state):
        kill(central, task, _wanted_by([asked], asked.module)._replace(origin=origin))


def _refusal_reason(central: State, task: Task, step: Transition, source: str) -> str:
    """Return why central refuses a request for the handler; "" if it grants the request."""
    message = task.message
    handler, cycle = task.handler, message.life_cycle
    if handler is None and message.handlers and source != message.initial_state:
        handler = message.handlers[-1]
    is_refused = handler is not None and step.name in handler.refuses
    if is_refused and cycle.refusal(task.state) is not None:
        return f"the handler of '{message.name}' takes no '{step.name}'"
    can_refuse = handler is not None and cycle.refusal(task.state) is not None
    if handler is not None and can_refuse and _restarts_against_wish(handler, cycle, step):
        names = _listed(list(handler.refuses))
        text = f"the handler of '{message.name}' takes no '{step.name}'"
        return f"{text}, and can't be called again: it refuses {names}"
    if step.effect is Effect.NEW_GOAL:
        try:
            check_order(central, task, None)
        except RequestError as error:
            return error.text
        return ""
    if cycle.ends_on_request(task.state):
        return ""
    return f"the handler of '{message.name}' knows no '{step.name}'"


def _restarts_against_wish(handler: Handler, cycle: LifeCycle, step: Transition) -> bool:
    """Whether the default update would end the work of a handler that refuses cancels."""
    return (
        step.effect is Effect.NEW_GOAL
        and step.name not in handler.takes
        and any(
            row.name in handler.refuses and cycle.ends_on_request(row.target)
            for row in cycle.transitions
        )
    )


def _accept_goal(central: State, task: Task, asked: ClientRequest) -> None:
    """Replace the task's goal. Grant the update if the life cycle has a transition for grants."""
    central.tree.pop_client_requests(task)
    _set_goal(central, task, asked.body)
    grant = task.message.life_cycle.grant(task.state)
    if grant is not None:
        text = "it starts again with the new goal"
        _apply_step(central, task, grant, Party.CENTRAL, "", text, request=asked.serial)


# --- changes by the server ------------------------------------------------------------------------


def _change_by_server(
    central: State, connection: Connection, header: ChangeState, body: bytes, task: Task
) -> None:
    """Apply a handler's transition. Then apply the clients' requests that it had not seen."""
    cycle, name = task.message.life_cycle, header.transition
    seen = header.serial if header.serial >= 0 else task.serial
    asked = task.clients.asked if task.clients is not None else []
    unseen = [request for request in asked if request.serial > seen]
    step, overtaken = cycle.step(task.state, name, Party.SERVER), False
    if unseen and (step is None or step.effect is not Effect.RESULT):
        earlier_step = cycle.step(unseen[0].source, name, Party.SERVER)
        step, overtaken = (earlier_step, True) if earlier_step is not None else (step, False)
    if step is None:
        _check_known(task, name, Party.SERVER)
        if task.clients is not None and seen < task.clients.newest:  # a client was first
            central.facts.append(facts.Ignored(connection.module.name, _too_late(task, name)))
            _answer(central, connection, header, 0)
            return
        raise RequestError(Refusal.PROTOCOL, _not_now(task, name, Party.SERVER))
    if cycle.is_over(step.target) and step.effect is not Effect.STOP:
        raise RequestError(
            Refusal.PROTOCOL, f"'{name}' ends {task}: its handler returns, or fails, instead"
        )
    if body and step.effect not in (Effect.RESULT, Effect.TAKE_GOAL):
        raise RequestError(Refusal.PROTOCOL, f"'{name}' of {task} has no data")
    _apply_server_step(central, task, step, connection.module.name, header.text, body, seen)
    if overtaken:
        central.tree.pop_client_requests(task, unseen.__contains__)
        for request in unseen:
            _apply_again(central, task, request)
    _answer(central, connection, header, task.serial)


def _answer(central: State, connection: Connection, header: ChangeState, serial: int) -> None:
    """Answer a server's request, if the server waits for an answer."""
    if header.number:
        central.accept(connection, header.number, serial)


def _apply_server_step(
    central: State, task: Task, step: Transition, module: str, text: str, body: bytes, seen: int
) -> None:
    """Apply the server's transition, and its effect on clients' requests."""
    if step.effect is Effect.RESULT:
        central.tree.pop_client_requests(
            task,
            lambda one: one.serial <= seen and not _awaits_decision(task, one.source, one.name),
        )
        central.tree.set_progress(task, body)
        _apply_step(central, task, step, Party.SERVER, module, text, body)
        return
    asked = central.tree.pop_client_requests(task)
    answered = max((one.serial for one in asked if one.serial <= seen), default=0)
    if step.effect is Effect.TAKE_GOAL:
        goals = [one.body for one in asked if one.serial <= seen and one.body]
        # The server may have changed the goal.
        if goal := body or (goals[-1] if goals else b""):
            _set_goal(central, task, goal)
        if any(one.body for one in asked if one.serial > seen):
            body = task.body  # the journal's readers would assume the newest goal
    if step.effect is Effect.STOP:
        kill(central, task, _wanted_by(asked, module))
        return
    _apply_step(central, task, step, Party.SERVER, module, text, body, request=answered)


def _apply_again(central: State, task: Task, asked: ClientRequest) -> None:
    """Apply a client's request after a change by the server, which had not seen the request."""
    step = (
        None if task.killed else task.message.life_cycle.step(task.state, asked.name, Party.CLIENT)
    )
    if step is None:
        central.facts.append(facts.Ignored(asked.module, _too_late(task, asked.name)))
    else:
        source, by = task.state, asked.module
        _apply_step(
            central, task, step, Party.CLIENT, by, asked.text, asked.body, request=asked.serial
        )
        central.tree.ask(task, asked._replace(source=source))


def _wanted_by(asked: list[ClientRequest], module: str) -> Verdict:
    """Return the verdict for a task to be ended, with the text of the newest request if any."""
    text, by = (asked[-1].text, asked[-1].module) if asked else ("", module)
    return Verdict(text or "a client cancels it", by)


def _set_goal(central: State, task: Task, goal: bytes) -> None:
    """Replace a task's data."""
    central.tree.grow(task, held_size(goal) - held_size(task.body))
    task.body = goal


# --- common parts ---------------------------------------------------------------------------------


def _apply_step(
    central: State,
    task: Task,
    step: Transition,
    by: Party,
    module: str,
    text: str,
    body: bytes = b"",
    *,
    request: int = 0,
) -> None:
    """Change the state. Report the change to the journal and to observers.

    *request* is the number of the client's request that the change makes or answers.
    """
    task.state = step.target
    task.serial += 1
    central.facts.append(
        facts.StateChanged(task.id, step.name, task.state, task.serial, by, module, text, body)
    )
    central.notify_observers(task, step.name, by, module, text, body, request=request)


def _check_known(task: Task, name: str, by: Party) -> None:
    """Raise RequestError if the table has no transition *name* for that party in any state."""
    cycle = task.message.life_cycle
    if name not in cycle.names(by):
        others = [
            party
            for party in (Party.CLIENT, Party.SERVER)
            if party is not by and name in cycle.names(party)
        ]
        hint = f", it is the {others[0]}'s" if others else ""
        names = _listed(cycle.names(by))
        text = f"a {by} can't take '{name}' of {task}{hint}: {cycle} has {names} for it"
        raise RequestError(Refusal.UNKNOWN, text)


def _too_late(task: Task, name: str) -> str:
    """Return why a transition is ignored: the other party's change came first."""
    return f"{task} is {task.state} by now: '{name}' comes too late"


def _not_now(task: Task, name: str, by: Party) -> str:
    """Return why a transition is not possible in the task's present state."""
    if task.message.life_cycle.is_pending(task.state, name):
        return f"another '{name}' of {task} is pending: it is '{task.state}'"
    sources = " or ".join(f"'{one}'" for one in task.message.life_cycle.sources(name, by))
    return f"{task} is '{task.state}': '{name}' is possible while it is {sources}"


def _listed(names: list[str]) -> str:
    return ", ".join(f"'{name}'" for name in names) or "nothing"
