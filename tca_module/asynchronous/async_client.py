"""AsyncClient: a client whose calls are coroutines on the user's own event loop."""

from functools import partial
from types import TracebackType
from typing import Self

from tca_module.asynchronous.async_sender import AsyncSender
from tca_module.asynchronous.connection_thread import ConnectionThread
from tca_module.asynchronous.forwarding import OnlyAsync, forwarded
from tca_module.client import Client, connect
from tca_module.link.connection import LINGER
from tca_module.link.opening import CentralAddress
from tca_module.link.waits import PATIENCE


class AsyncClient(AsyncSender, OnlyAsync):
    """A ``Client`` for the user's own event loop; ``aconnect()`` returns it.

    One thread of the library owns its connection. Any number of asyncio tasks share it. Use it in
    an ``async with`` block, or await ``open()`` and ``close()``.
    """

    def __init__(self, thread: ConnectionThread) -> None:
        super().__init__(thread.run, None)
        self._thread = thread

    def __repr__(self) -> str:
        return f"async {self._blocking!r}" if self._blocking else "an async client that is not open"

    async def open(self) -> Self:
        """Connect to central. Raises what ``connect`` does.

        Returns:
            This client.
        """
        self._blocking = await self._thread.open()
        return self

    async def close(self) -> None:
        """Say goodbye to central when all sent messages have arrived. May be called again.

        Calls that still wait raise Stopped.

        Raises:
            NotSent: messages may not have arrived.
        """
        await self._thread.close()

    status = forwarded(Client.status)

    async def __aenter__(self) -> Self:
        return await self.open()

    async def __aexit__(
        self, _: object, error: BaseException | None, __: TracebackType | None
    ) -> None:
        await self._thread.close(error)


def aconnect(
    name: str = "script",
    central: CentralAddress = None,
    patience: float = PATIENCE / 2,
    *,
    linger: float = LINGER,
) -> AsyncClient:
    """Connect to central from an asyncio program.

    Args:
        name: the name by which central knows the client, 1 to 128 printable characters. Default:
            "script".
        central: an address such as "tcp://rover:7400", or several with commas, of which one central
            leads; or a ``LocalCentral``. Default: None, which means ``$TCA_CENTRAL`` or else the
            default socket.
        patience: the seconds to wait for central at the start; also the seconds of central's
            silence after which a call raises CentralLost, and with several addresses at least 30.
            Default: 5.
        linger: the most seconds that the end of the block waits for sent messages to arrive.
            Default: 10.

    Returns:
        The AsyncClient, which connects at the start of its ``async with`` block.

    Raises:
        CentralLost: at the start of the block: no central answered within *patience* seconds.
        Refused: at the start of the block: central does not admit this program.
        NotSent: at the end of the block: messages may not have arrived.
        MisuseError: at the start of the block: an argument has the wrong type or range.

    Example::

        async with aconnect("operator") as user:
            heights = await asyncio.gather(*(user.query(HEIGHT, x) for x in range(100)))
    """
    opening = partial(connect, name, central, patience, linger=linger)
    return AsyncClient(ConnectionThread(opening, f"async client '{name}'"))
