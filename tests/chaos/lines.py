"""Lines between programs, which can be cut, or hold what is sent: a proxy for TCP connections.

A line that holds bytes looks like a network without a path: its connections stay open, and nothing
arrives. What was sent may arrive when the line is whole again, as TCP repeats it.
"""

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar, cast

T = TypeVar("T")


class _End(asyncio.Protocol):
    """One end of a connection through a line."""

    def __init__(self, line: "Line", *, is_near: bool) -> None:
        self.line, self.is_near = line, is_near
        self.other: _End | None = None
        self.transport: asyncio.Transport | None = None
        self.reasons = set[str]()  #: why nothing is read
        self.early: list[bytes] = []  #: before the other end is there

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        self.line.accept(self)

    def data_received(self, data: bytes) -> None:
        if self.other is None or self.other.transport is None:
            self.early.append(data)
        else:
            self.other.transport.write(data)

    def connection_lost(self, error: Exception | None) -> None:
        self.line.ends.discard(self)
        if self.other is not None and self.other.transport is not None:
            self.other.transport.close()

    def pause_writing(self) -> None:
        if self.other is not None:
            self.other.pause("full")

    def resume_writing(self) -> None:
        if self.other is not None:
            self.other.resume("full")

    def pause(self, reason: str) -> None:
        """Read nothing more."""
        if self.transport is not None and not self.reasons and not self.transport.is_closing():
            self.transport.pause_reading()
        self.reasons.add(reason)

    def resume(self, reason: str) -> None:
        """Read again, unless there is another reason not to."""
        is_paused = bool(self.reasons)
        self.reasons.discard(reason)
        may_read = self.transport is not None and not self.transport.is_closing()
        if is_paused and not self.reasons and may_read:
            assert self.transport is not None
            self.transport.resume_reading()


class Line:
    """A port of this computer that leads to another one, through a line that can fail.

    *there* is the direction to the target, *back* the other one.
    """

    def __init__(self, lines: "Lines", name: str, target: int) -> None:
        self.name, self.port = name, 0
        self.ends = set[_End]()
        self._lines, self._target = lines, target
        self._is_cut = self._holds_there = self._holds_back = False

    def cut(self) -> None:
        """Close all connections, and refuse new ones."""
        self._lines.call(self._set(is_cut=True))

    def hold(self, *, there: bool = True, back: bool = True) -> None:
        """Let nothing through in these directions. Connections stay open."""
        self._lines.call(self._set(there=there, back=back))

    def mend(self, *, drops: bool = False) -> None:
        """Let all through again. With *drops* the connections break, with all that was held."""
        self._lines.call(self._set(drops=drops))

    async def open(self) -> None:
        """Listen."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: _End(self, is_near=True), "127.0.0.1", 0, backlog=100
        )
        self.port = self._server.sockets[0].getsockname()[1]

    def close(self) -> None:
        """Listen no more, and close all connections. Only in the lines' thread."""
        self._is_cut = True
        self._server.close()
        for end in list(self.ends):
            self._abort(end)

    async def _set(
        self,
        *,
        is_cut: bool = False,
        there: bool = False,
        back: bool = False,
        drops: bool = False,
    ) -> None:
        was_held = self._holds_there or self._holds_back
        self._is_cut, self._holds_there, self._holds_back = is_cut, there, back
        for end in list(self.ends):
            if is_cut or (drops and was_held):
                self._abort(end)
            else:
                self._apply(end)

    def _apply(self, end: _End) -> None:
        if self._holds_there if end.is_near else self._holds_back:
            end.pause("held")
        else:
            end.resume("held")

    def _abort(self, end: _End) -> None:
        if end.transport is not None:
            end.transport.abort()

    def accept(self, end: _End) -> None:
        """Connect the other end of a new connection."""
        if self._is_cut:
            self._abort(end)
            return
        self.ends.add(end)
        self._apply(end)
        if end.is_near:
            self._lines.start(self._connect(end))

    async def _connect(self, near: _End) -> None:
        far = _End(self, is_near=False)
        far.other = near
        loop = asyncio.get_running_loop()
        try:
            await loop.create_connection(lambda: far, "127.0.0.1", self._target)
        except OSError:
            self._abort(near)
            return
        near.other = far
        if near not in self.ends or far.transport is None:
            self._abort(far)
            return
        for data in near.early:
            far.transport.write(data)


class Lines:
    """All lines of a life. They have a thread of their own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._tasks = set[asyncio.Task[None]]()
        self._all: list[Line] = []
        self._thread = threading.Thread(target=self._loop.run_forever, name="lines", daemon=True)
        self._thread.start()

    def add(self, name: str, target: int) -> Line:
        """Return a new line to a port."""
        line = Line(self, name, target)
        self.call(line.open())
        self._all.append(line)
        return line

    def call(self, work: Coroutine[Any, Any, T]) -> T:
        """Run something in the lines' thread."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Start something in the lines' thread, from there."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """Close all lines."""
        self.call(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _close(self) -> None:
        for line in self._all:
            line.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0)  # connections close in the loop's next round
