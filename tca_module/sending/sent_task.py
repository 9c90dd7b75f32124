"""A task that one has sent: its points, its end and its result."""

from collections.abc import Generator
from typing import Any, Generic

from tca_module.errors import NIL, BadData, TaskFailed, TaskKilled
from tca_module.link.connection import Connection
from tca_module.sending.task_ref import TaskRef
from tca_wire.messages.declarations import Message, R
from tca_wire.packets.headers import Answer
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome

_DEALT_WITH = "an exception handler dealt with it, so there is no result"


class SentTask(TaskRef, Generic[R]):
    """A task that was sent. Its points, such as ``sent.achieving.end``, are for constraints.

    In an async handler ``await sent`` gives what ``sent.result()`` does; ``asyncio.timeout`` limits the wait.
    """

    def __init__(self, connection: Connection, message: Message[Any, R], task_id: TaskId, origin: int) -> None:
        super().__init__(connection, message.name, task_id, origin)
        self._message = message

    def result(self, timeout: float | None = None) -> R:
        """The value that the handler returned; waits for the task's end, at most *timeout* seconds. Raises TaskFailed,
        TaskKilled or Timeout.
        """
        is_new = self._end is None
        answer, body = self._ended(timeout)
        if is_new and answer.outcome is not Outcome.DONE:
            self._connection.mark_told()
        return self._result(answer, body)

    def __await__(self) -> Generator[Any, None, R]:
        if self._end is None:
            what, request = self._ask(self.achieving.end, blocking=False)
            yield from self._connection.until_over(request, f"the wait for {what}")
            self._end = request.answers[-1]
        return self._result(*self._end)

    def _result(self, answer: Answer, body: bytes) -> R:
        if answer.outcome is Outcome.FAILED:
            raise TaskFailed(repr(self), answer.failure, answer.text, body)
        if answer.outcome is Outcome.KILLED:
            raise TaskKilled(repr(self), answer.text)
        if answer.failure and not body and self._message.reply.kind is not type(None):
            first, newline, rest = answer.text.partition("\n")
            text = (f"{first} ({_DEALT_WITH})" if first else _DEALT_WITH) + newline + rest
            raise TaskFailed(repr(self), answer.failure, text, b"")
        try:
            return self._message.decode_reply(body or NIL)
        except BadData as error:
            if body:
                raise
            msg = f"the result of {self} is no longer kept: call result() sooner after its end ({error})"
            raise BadData(msg) from None
