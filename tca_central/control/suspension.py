"""Tasks are suspended and resumed, with all under them."""

from tca_central.model.deliveries import Connection
from tca_central.outgoing.central_messages import suspend
from tca_central.state import State
from tca_wire.packets import headers


def on_suspend(central: State, connection: Connection, header: headers.Suspend, _: bytes) -> None:
    """A module suspends or resumes a task with all under it (TCM: Suspend, Unsuspend)."""
    task = central.tree.task(header.task)
    if task is None:
        central.ignore(connection, header.number, f"task {header.task} has ended: it can't be suspended or resumed")
        return
    suspend(central, task, resume=header.resume, by=connection.module.name)
    central.accept(connection, header.number, task.id)
