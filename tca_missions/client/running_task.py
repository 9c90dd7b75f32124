"""The tasks of a server that run now, whoever has started them."""

from typing import Any

import msgspec

from tca_module import Sender, TaskInfo
from tca_wire.messages.formats import decode_untyped


class RunningTask(msgspec.Struct, frozen=True):
    """A task of a server that has not ended."""

    id: int
    name: str
    state: str
    """"waits", "runs", "suspended" or "is being stopped"."""
    parameters: dict[str, Any]
    """Those that were given."""

    def __str__(self) -> str:
        given = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"{self.name}({given}) {{{self.id}}} {self.state}"


def running_tasks(sender: Sender, server: str) -> list[RunningTask]:
    """The tasks of a server that have not ended, oldest first."""
    prefix = f"{server}."
    infos = [ref.info() for ref in sender.tasks() if ref.message.startswith(prefix)]
    found = [_running(info, info.message.removeprefix(prefix)) for info in infos if info is not None]
    return sorted(found, key=lambda task: task.id)


def _running(info: TaskInfo, name: str) -> RunningTask:
    state = "runs" if info.module else "waits"
    state = "suspended" if info.suspended else state
    data = decode_untyped(info.data)
    return RunningTask(
        info.id, name, "is being stopped" if info.killed else state, data if isinstance(data, dict) else {}
    )
