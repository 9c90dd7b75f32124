"""The permissions that requests need: a row for each message of the protocol.

Permissions are checked only if there are rules. A principal needs no permission for tasks that it
has sent or handles. A handler's answer needs none: it counts only from the slot that has the
message. A request that ends a wait of its own connection needs none. A request about something that
does not exist passes this check: the function that carries out the request refuses it.
"""

from collections.abc import Callable, Iterable
from typing import Never, TypeVar, cast

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection, Delivery, Holder, Module
from tca_central.model.tasks import Task, TaskRecord
from tca_central.state import State
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Permission, Refusal, Role, Scope

H = TypeVar("H", bound=headers.ToCentral)

SEND, HANDLE, TAP = Permission.SEND, Permission.HANDLE, Permission.TAP
LOCK, KILL, ADMINISTER = Permission.LOCK, Permission.KILL, Permission.ADMINISTER

OPEN_TOPICS = ("messages", "modules", "sent")
"""Topics that need no permission: the module library asks for them to explain errors."""


def check(central: State, connection: Connection, header: headers.ToCentral) -> None:
    """Raise RequestError if a connection may not make that request."""
    if (check_needs := NEEDS[type(header)]) is not None:
        check_needs(central, connection, cast("Never", header))


def forbidden(connection: Connection, what: str) -> RequestError:
    """Return the error for a connection that may not do *what*."""
    module = connection.module
    owner = f" ({module.principal})" if module.principal else ""
    return RequestError(
        Refusal.FORBIDDEN, f"module '{module.name}'{owner} may not {what}: see the permissions file"
    )


def _need(connection: Connection, permission: Permission, name: str) -> None:
    """Raise RequestError if a permission does not include a name; the name "" always passes."""
    if name and not _may(connection, permission, name):
        raise forbidden(connection, f"{permission} '{name}'")


def _may(connection: Connection, permission: Permission, name: str) -> bool:
    """Whether a permission of a connection includes a name."""
    return connection.rights is None or connection.rights.allow(permission, name)


def _may_any(connection: Connection, permissions: Iterable[Permission], name: str) -> bool:
    """Whether any of these permissions includes a name."""
    return any(_may(connection, permission, name) for permission in permissions)


# --- tasks ----------------------------------------------------------------------------------------


def _is_own(connection: Connection, task: Task) -> bool:
    """Whether a connection's principal has sent a task, or handles it."""
    principal, sender, slot = connection.principal, task.sent_by, task.slot
    if isinstance(sender, Module) and sender.principal == principal:
        return True
    return slot is not None and slot.principal == principal


def _decides_for(central: State, connection: Connection, task: Task) -> bool:
    """Whether an exception handler asks, for a failure of *task* or of a task under it."""
    asking: Delivery | None = central.dispatcher.running.get(central.origin)
    if (
        not isinstance(asking, Task)
        or asking.role is not Role.EXCEPTION
        or asking.slot is not connection
    ):
        return False
    return asking.parent is not None and asking.parent.find_above(task.id) is task


def _check_control(central: State, connection: Connection, number: TaskId, what: str) -> None:
    """Raise RequestError if a connection may not do *what* to a task.

    A task that has ended needs no permission: it does not change.
    """
    task = central.tree.tasks.get(number)
    if number == ROOT:
        _need(connection, ADMINISTER, "root")
    if task is None or _is_own(connection, task) or _may(connection, KILL, task.message.name):
        return
    if not _decides_for(central, connection, task):
        raise forbidden(connection, f"{what} {task}, which is not its own")


def _check_see(central: State, connection: Connection, number: TaskId) -> None:
    """Raise RequestError if a connection may not see the work or the outcome of a task."""
    task = central.tree.tasks.get(number)
    if task is not None:
        may_see = _is_own(connection, task) or _may_any(connection, (TAP, KILL), task.message.name)
        if not may_see and not _decides_for(central, connection, task):
            raise forbidden(connection, f"see {task}, which is not its own")
        return
    owner = central.registry.permissions.outcome_owners.get(number)
    record = central.memory.records.get(number)
    if (
        owner == connection.principal
        or (owner is None and record is None)
        or _may(connection, ADMINISTER, "tree")
    ):
        return
    if record is None or not _may_see_record(connection, record):
        raise forbidden(connection, f"see task {{{number}}}, which was not its own")


def _may_see_record(connection: Connection, record: TaskRecord) -> bool:
    """Whether a connection may see the record of an ended task.

    It may if a module of its principal retains the task, or if it has a permission for the message.
    """
    is_own = any(module.principal == connection.principal for module in record.retention.by)
    return is_own or _may_any(connection, (TAP, KILL), record.message.name)


def _constrain(
    central: State, connection: Connection, header: headers.Send | headers.Constrain
) -> None:
    for constraint in header.constraints:
        if constraint.after.task > 0:  # else the sent task itself, or the root
            _check_control(central, connection, constraint.after.task, "constrain")


# --- the check of each message --------------------------------------------------------------------


def _kill(central: State, connection: Connection, header: headers.Kill) -> None:
    # A negative number is that of the request that sent the task.
    number = connection.tasks.get(-header.task) if header.task < 0 else header.task
    if number is None:
        return  # the task was never sent
    _check_control(central, connection, number, "kill")
    task = central.tree.tasks.get(number)
    if header.scope is Scope.SIBLINGS and task is not None and task.parent is not None:
        _check_control(central, connection, task.parent.id, "kill what is under")


def _register(_: State, connection: Connection, header: headers.Register) -> None:
    for declared in header.messages:
        if not _may_any(connection, (SEND, HANDLE, TAP), declared.name):
            raise forbidden(connection, f"declare '{declared.name}'")
        for needed in declared.needs:
            _need(connection, SEND, needed)
    for handled in header.handlers:
        _need(connection, HANDLE, handled.message)


def _send(central: State, connection: Connection, header: headers.Send) -> None:
    _need(connection, SEND, header.message)
    if header.parent:
        _check_control(central, connection, header.parent, "send under")
    _constrain(central, connection, header)
    for attachment in header.attachments:
        _need(connection, SEND, attachment.handler)
    if header.retry is not None and header.retry.fallback:
        _need(connection, SEND, header.retry.fallback)


def _attach(central: State, connection: Connection, header: headers.Attach) -> None:
    _need(connection, SEND, header.attachment.handler)
    if header.message:
        _need(connection, TAP, header.message)
    elif header.task:
        _check_control(central, connection, header.task, "attach an exception handler to")
    else:
        _need(connection, ADMINISTER, "attach")


def _remove(central: State, connection: Connection, header: headers.Remove) -> None:
    if (attached := central.attached.get(header.id)) is not None:
        is_own = _are_own(central, connection, attached.holders.values())
    elif (tap := central.taps.get(header.id)) is not None:
        is_own = not header.for_all or _are_own(central, connection, tap.holders.values())
    else:
        task = central.tree.tasks.get(header.id)
        is_own = task is None or _is_own(connection, task)
    if not is_own:
        _need(connection, ADMINISTER, "detach")


def _are_own(central: State, connection: Connection, holders: Iterable[Holder]) -> bool:
    """Whether all holders of an attachment are connected modules of the connection's principal."""
    modules = [central.registry.modules.get(holder.run) for holder in holders]
    return all(one is not None and one.principal == connection.principal for one in modules)


def _tap(central: State, connection: Connection, header: headers.Tap) -> None:
    _need(connection, SEND, header.listener)
    if header.message:
        _need(connection, TAP, header.message)
    elif (task := central.tree.tasks.get(header.task)) is not None:
        if not _is_own(connection, task):
            _need(connection, TAP, task.message.name)
    else:
        _check_see(central, connection, header.task)
        _need(connection, TAP, header.of)


def _observe(central: State, connection: Connection, header: Observe | headers.Inspect) -> None:
    if header.task:
        _check_see(central, connection, header.task)
    elif isinstance(header, Observe) and header.message and not header.below:
        _need(connection, TAP, header.message)
    else:
        _need(connection, ADMINISTER, "tree")


def _fire(central: State, connection: Connection, header: headers.Fire) -> None:
    _need(connection, SEND, header.action)
    if header.message:
        _need(connection, SEND, header.message)
    elif (task := central.tree.tasks.get(header.monitor)) is not None and not _is_own(
        connection, task
    ):
        _need(connection, SEND, task.message.name)


def _get_variable(_: State, connection: Connection, header: headers.GetVariable) -> None:
    if not _may_any(connection, (HANDLE, SEND), header.variable):
        raise forbidden(connection, f"get '{header.variable}'")


def _lock(central: State, connection: Connection, header: headers.Lock) -> None:
    """Raise RequestError if a connection may not lock all resources that the request may mean."""
    for module in central.registry.modules.values():
        if module is connection.module or header.resource not in module.resources:
            continue
        if header.module in ("", module.name, module.called):
            _need(connection, LOCK, f"{module.called}.{header.resource}")


def _ask(_: State, connection: Connection, header: headers.Ask) -> None:
    if header.topic not in OPEN_TOPICS:
        _need(connection, ADMINISTER, header.topic)


def _controls(what: str, number: Callable[[H], TaskId]) -> Callable[[State, Connection, H], None]:
    """Return the check of a request that does *what* to a task, which *number* gets from it."""
    return lambda central, connection, header: _check_control(
        central, connection, number(header), what
    )


NEEDS: dict[type, Callable[[State, Connection, Never], None] | None] = {
    headers.Hello: None,  # joining.py checks the names that a principal may have
    headers.Register: _register,
    headers.Unregister: None,
    headers.Send: _send,
    headers.Reply: None,
    headers.Replies: None,
    headers.Fail: None,
    headers.Postpone: None,
    headers.Constrain: _constrain,
    headers.AwaitPoint: lambda central, connection, header: _check_see(
        central, connection, header.point.task
    ),
    headers.Await: None,
    headers.AwaitAny: None,
    headers.GiveUp: None,
    headers.Release: None,
    headers.Kill: _kill,
    headers.Ask: _ask,
    headers.Attach: _attach,
    headers.Remove: _remove,
    headers.Raise: _controls("raise a failure on", lambda header: header.task),
    headers.Retry: _controls("retry", lambda header: header.task),
    headers.Resolve: None,
    headers.Suspend: _controls("suspend", lambda header: header.task),
    headers.Deadline: _controls("give a deadline to", lambda header: header.point.task),
    headers.Inspect: _observe,
    ChangeState: _controls("change the state of", lambda header: header.task),
    Observe: _observe,
    headers.Tap: _tap,
    headers.Fire: _fire,
    headers.EndMonitor: _controls("end", lambda header: header.monitor),
    headers.Keep: lambda central, connection, header: _check_see(central, connection, header.task),
    headers.Recalled: None,
    headers.Bye: None,
    headers.Receipt: None,
    headers.UsesStore: None,
    headers.GetVariable: _get_variable,
    headers.SetVariable: lambda _, connection, header: _need(connection, SEND, header.variable),
    headers.WaitUntilHandled: None,
    headers.Lock: _lock,
    headers.Unlock: lambda _, connection, __: _need(connection, ADMINISTER, "unlock"),
    headers.GoOn: lambda _, connection, __: _need(connection, ADMINISTER, "resume"),
    headers.EndCentral: lambda _, connection, __: _need(connection, ADMINISTER, "stop"),
}
"""One row per message: the check of its permissions; None: it needs none."""
