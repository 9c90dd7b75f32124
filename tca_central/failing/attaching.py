"""Attaches exception handlers to a task, to a message's tasks or to the root; removes them."""

from tca_central.errors import RequestError, check_name
from tca_central.model.budget import ATTACHED_BYTES
from tca_central.model.deliveries import AttachedHandler, Connection, MessageType, Module
from tca_central.model.tasks import Recovery, Task
from tca_central.state import State
from tca_central.watching.taps import remove as remove_tap
from tca_central.watching.watches import end_monitor
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT
from tca_wire.vocabulary import Refusal

MOST_ATTACHED = 1000
"""Exception handlers of one task or message."""


def on_attach(central: State, connection: Connection, header: headers.Attach, _: bytes) -> None:
    """Attach a module's exception handler to a task, to a message's tasks, or to the root."""
    message = _task_message(central, header.message) if header.message else None
    task = central.tree.root if header.task == ROOT else central.tree.task(header.task)
    if task is None:
        text = f"task {{{header.task}}} has ended: no exception handler can be attached to it"
        raise RequestError(Refusal.TOO_LATE, text)
    attached = attach(central, header.attachment, message or task, connection.module)
    central.accept(connection, header.number, attached.id)


def _task_message(central: State, name: str) -> MessageType:
    """Return the message of that name. Raises RequestError unless it is a goal or command."""
    message = central.registry.messages.get(name)
    if message is None or not message.message_class.is_task:
        what = f"a {message.message_class}" if message else "not declared"
        text = f"'{name}' is {what}: attach exception handlers to tasks, goals and commands"
        raise RequestError(Refusal.UNKNOWN, text)
    return message


def check_attachments(central: State, wanted: list[Attachment]) -> None:
    """Raise RequestError if one of the *wanted* exception handlers can't be attached."""
    if len(wanted) > MOST_ATTACHED:
        raise RequestError(
            Refusal.OVERLOAD, f"{len(wanted):,} exception handlers: {MOST_ATTACHED:,} are allowed"
        )
    for attachment in wanted:
        check_name("failure", attachment.failure, or_none=True)
        handler = central.registry.messages.get(attachment.handler)
        if handler is None or not handler.message_class.handles_failures:
            what = f"a {handler.message_class}" if handler else "not declared"
            raise RequestError(
                Refusal.UNKNOWN, f"'{attachment.handler}' is {what}, not an exception handler"
            )


def attach(
    central: State, wanted: Attachment, place: Task | MessageType, by: Module
) -> AttachedHandler:
    """Attach an exception handler as the newest of its place.

    An equal attachment of the same module, or of a copy of that module, is replaced.
    """
    check_attachments(central, [wanted])
    others = Recovery.of(place).attached if isinstance(place, Task) else place.attached
    key = (wanted.failure, wanted.handler, by.called)
    earlier = next((one for one in others if (one.failure, one.handler.name, one.by) == key), None)
    if earlier is not None:
        _remove(central, earlier, by.called)
    else:
        central.check_declared(ATTACHED_BYTES)
    if len(others) >= MOST_ATTACHED:
        raise RequestError(
            Refusal.OVERLOAD, f"{place} has {MOST_ATTACHED} exception handlers already"
        )
    handler = central.registry.messages[wanted.handler]
    attached = AttachedHandler(
        central.new_id(), wanted.failure, handler, max(0, wanted.maximum), place, by.called
    )
    copies = earlier.holders.values() if earlier is not None else ()
    attached.holders = {
        one.name: one for one in (*copies, by.holder) if one.run in central.registry.modules
    }
    others.append(attached)
    central.attached[attached.id] = attached
    task, message = (place.id, "") if isinstance(place, Task) else (ROOT, place.name)
    central.facts.append(
        facts.Attached(attached.id, attached.failure, handler.name, task, message, attached.maximum)
    )
    return attached


def on_remove(central: State, connection: Connection, header: headers.Remove, _: bytes) -> None:
    """Remove an exception handler, or end a module's hold on a wiretap.

    With ``for_all``, which operators use, remove a wiretap for all modules, or end a monitor.
    """
    module, removed = connection.module, header.id
    if (attached := central.attached.get(header.id)) is not None:
        _remove(central, attached, module.name)
    elif (tap := central.taps.get(header.id)) is not None:
        remove_tap(central, tap, module, for_all=header.for_all)
    elif not 0 < header.id <= central.tree.newest:
        raise RequestError(
            Refusal.UNKNOWN, f"there is no exception handler or wiretap {{{header.id}}}"
        )
    elif not (header.for_all and _end_monitor_by_id(central, header.id, module.name)):
        removed = 0
    central.accept(connection, header.number, removed)


def _end_monitor_by_id(central: State, number: int, by: str) -> bool:
    """End a monitor. Return False if it had ended. Raise RequestError if the id is no monitor's."""
    task = central.tree.tasks.get(number)
    if task is None:
        return False
    watch = task.watch
    if watch is None:
        text = f"{task} is a {task.message.message_class}, which is not attached: kill it to end it"
        raise RequestError(Refusal.PROTOCOL, text)
    if watch.is_over:
        return False
    end_monitor(central, watch, f"by module '{by}'")
    return True


def _remove(central: State, attached: AttachedHandler, by: str) -> None:
    """Remove an exception handler from its task or message."""
    attached.place.attached.remove(attached)
    del central.attached[attached.id]
    central.facts.append(facts.Removed(attached.id, by))


def forget_task(central: State, task: Task) -> None:
    """Forget the attachments of a task that has ended."""
    for attached in task.attached:
        del central.attached[attached.id]
