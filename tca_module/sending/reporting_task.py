"""The state of a task, for those who work on it: they accept it, report results, hear what clients ask for."""

from typing import Any

from tca_module.checks import NAME, TEXT, check
from tca_module.errors import BadData, MisuseError
from tca_module.sending.task_requests import ServerState, TaskRequest
from tca_wire.messages.declarations import Message, TaskMessage


class ReportingTask:
    """A task that somebody works on: its handler, or whoever owes its reply."""

    _message: Message[Any, Any]

    def _served(self) -> ServerState:
        """The task's state. Raises MisuseError for what is no task."""
        raise NotImplementedError

    @property
    def state(self) -> str:
        """The task's state, as far as is known here. Never waits."""
        return self._served().state

    def accept(self) -> None:
        """Say that the task is begun; for handlers declared with ``accepts=True``. If an early cancel was rejected,
        that has begun it, and this says nothing more.
        """
        self._served().begin()

    def report(self, data: Any = None) -> None:
        """Tell those who follow the task of an intermediate result, of the type *progress* of its message. Does not
        wait. Raises BadData.
        """
        message = self._message
        if not isinstance(message, TaskMessage):
            raise MisuseError(f"{self} can't report(): only goals and commands have intermediate results")
        served = self._served()
        if data is not None and message.progress.kind is type(None):
            raise MisuseError(f"{message.title} is declared without progress=, and report() was given {data!r:.60}")
        try:
            body = message.progress.encode(data)
        except BadData as error:
            raise BadData(f"the intermediate results of {message.title} are {message.progress}: {error}") from None
        served.report(body)

    def take(self, transition: str, why: str = "") -> None:
        """Take a server's transition of the task's own life cycle: ``task.take("paused")``. Raises MisuseError for one
        that is no server's, or not possible in the task's state.
        """
        check(f"take() of {self}", NAME, transition=transition)
        check(f"'{transition}' of {self}", TEXT, why=why)
        self._served().take(transition, why)

    @property
    def request(self) -> TaskRequest | None:
        """The oldest open request of a client, if there is one: for handlers that say in ``takes=`` what they hear.
        Never waits.
        """
        return self._served().oldest
