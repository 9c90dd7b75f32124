"""The sleeps of coroutines, on the clock of handlers: the one that a test may step."""

import asyncio
import heapq
import itertools
import math

from tca_module.sockets.transport import Transport


class Sleeps:
    """The moments for which the coroutines of one event loop wait."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._numbers = itertools.count()
        self._sleeping: list[tuple[float, int, asyncio.Future[None]]] = []  #: a heap; of one moment in their order

    async def until(self, moment: float) -> None:
        """Wait until that moment."""
        future = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleeping, (moment, next(self._numbers), future))
        await future

    def seconds(self) -> float:
        """The real seconds to wait for the next moment: for ever, if a test steps the clock, which ends the wait."""
        while self._sleeping and self._sleeping[0][2].done():  # it was cancelled
            heapq.heappop(self._sleeping)
        return self._transport.seconds_until(self._sleeping[0][0]) if self._sleeping else math.inf

    def wake(self) -> None:
        """Let those go on whose moment has come."""
        while self.seconds() <= 0:
            _, _, future = heapq.heappop(self._sleeping)
            future.set_result(None)
