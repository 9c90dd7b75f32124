"""A connection to the NATS servers of a replicated log. It waits until they answer.

The client library of NATS is asynchronous. Its loop runs only while a call waits, in the thread of
that call: another thread would cost each append a quarter of its time.
"""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Collection, Coroutine, Sequence
from typing import Any, TypeVar

from nats.aio.client import Client
from nats.errors import Error as NatsError
from nats.errors import MaxPayloadError
from nats.js import JetStreamContext
from nats.js.errors import BadRequestError, NoStreamResponseError, NotFoundError

from tca_central.errors import CentralError
from tca_central.replication.log_checks import check_payload, explanation, is_full, is_refusal
from tca_central.replication.shared_log import LogUnreachable
from tca_wire.log_address import user_in, without_secrets

log = logging.getLogger("tca.central")
logging.getLogger("asyncio").setLevel(logging.ERROR)  # it warns of each connection with TLS

PATIENCE = 15.0
"""Seconds to wait for the log at the start. It elects another leader within about six."""
REPORT_AFTER = 3.0
"""Seconds without an answer after which central says why it waits."""
_LAST_PATIENCE = 2.0
"""Seconds to wait for the log once central must end."""
_REPLY_WITHIN = 1.0
_WRONG_LAST = 10071

T = TypeVar("T")


class WrongLast(Exception):
    """The log's last message is not the one that an append expects."""

    def __str__(self) -> str:
        return "too few of its servers run to store a message"


class JetStreamConnection:
    """A connection, for one thread at a time.

    Args:
        servers: Addresses of the servers, ``nats://host:port``.
        stream: The name of the log's stream. Its end ends central.
    """

    def __init__(self, servers: Sequence[str], stream: str) -> None:
        #: Whether calls fail that wait for the log, because this program must end.
        self.gives_up: Callable[[], bool] = lambda: False
        self.servers, self.stream = list(servers), stream
        self.is_open = False  #: whether calls wait without end
        self.client = Client()
        self.api: JetStreamContext
        #: Called after each connection, also a new one.
        self.on_connected: Callable[[], Coroutine[Any, Any, None]] | None = None
        self._problem: Exception | None = None  #: the newest error that no call has got
        self._reported = 0.0  #: when it was said that central waits; 0: it does not
        self._loop = asyncio.new_event_loop()
        user, password = user_in(self.servers[0])
        self._credentials = {"user": user, "password": password} if password else {"token": user}

    def call(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a call to its end. Raises CentralError."""
        return self._loop.run_until_complete(work)

    def begin(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        """Begin work that continues during later calls."""
        return self._loop.create_task(work)

    def close(self, begun: "Collection[asyncio.Task[None]]" = ()) -> None:
        """Wait for work that has begun, up to a second, and disconnect."""
        if not self._loop.is_closed():
            self.call(self._close(set(begun)))
            self._loop.close()

    async def _close(self, begun: "set[asyncio.Task[None]]") -> None:
        if begun:
            await asyncio.wait(begun, timeout=_REPLY_WITHIN)
        with contextlib.suppress(NatsError, asyncio.TimeoutError, OSError):
            await asyncio.wait_for(self.client.close(), 1.0)
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    async def open(self) -> None:
        """Connect. Raises CentralError."""
        await self.until_answered(self._connect)

    async def _connect(self) -> None:
        self.client = Client()
        connecting = self.client.connect(
            self.servers,
            **self._credentials,  # also for servers that the first ones tell of
            error_cb=self._note_problem,
            max_reconnect_attempts=-1,
            reconnect_time_wait=0.1,
            connect_timeout=1,
            ping_interval=1,
            max_outstanding_pings=2,
        )
        # Without a limit the client tries for ever.
        await asyncio.wait_for(connecting, min(PATIENCE, 1 + len(self.servers)))
        self.api = self.client.jetstream(timeout=_REPLY_WITHIN)
        if (server := self.client.connected_url) is not None:
            check_payload(server.netloc, self.client.max_payload)
        if self.on_connected is not None:
            await self.on_connected()

    async def _note_problem(self, error: Exception) -> None:
        """Note an error of the connection. Calls that it concerns fail, or time out."""
        if self._problem is None or not is_refusal(self._problem):
            self._problem = error

    # --- patience ---------------------------------------------------------------------------------

    async def until_answered(self, work: Any, *args: Any, since: float | None = None) -> Any:
        """Repeat a call, which began at *since*, until the servers answer.

        Raises CentralError, NotFoundError, and WrongLast for an append.
        """
        start = time.monotonic() if since is None else since
        while True:
            try:
                return await work(*args)
            except NotFoundError:
                raise
            except (TimeoutError, NatsError, OSError) as error:
                if isinstance(error, BadRequestError) and error.err_code == _WRONG_LAST:
                    raise WrongLast from None
                await self.pause(start, error)

    async def pause(self, start: float, error: Exception) -> None:
        """Pause before a call that began at *start* is repeated. Raises CentralError to end it."""
        if isinstance(error, MaxPayloadError):
            check_payload("of the log", self.client.max_payload)
        if is_full(error):
            self._problem = error
        elif self._problem is not None and isinstance(error, (TimeoutError, NoStreamResponseError)):
            error = self._problem  # it says more
        now = time.monotonic()
        patience = _LAST_PATIENCE if self.gives_up() else float("inf") if self.is_open else PATIENCE
        if now > start + patience or (is_refusal(error) and not self.is_open):
            raise self._unreachable(error) from None
        if now > max(start, self._reported) + REPORT_AFTER and self.is_open:
            await self._check_existence()
        if now > start + REPORT_AFTER and not self._reported:
            self._reported = now
            log.error("%s; central waits", self._unreachable(error))
        if self.client.is_closed and self.is_open:  # the client gives up after some errors
            with contextlib.suppress(TimeoutError, NatsError, OSError):
                await self._connect()
        await asyncio.sleep(0.05)

    def note_answer(self) -> None:
        """Note that the servers have answered."""
        self._problem = None
        if self._reported:
            self._reported = 0.0
            log.warning("the log answers again")

    async def _check_existence(self) -> None:
        """Raise CentralError if the stream was deleted."""
        try:
            await self.api.stream_info(self.stream)
        except NotFoundError:
            raise self.lost("was deleted") from None
        except (TimeoutError, NatsError, OSError):
            return

    def lost(self, what: str) -> CentralError:
        """Return the error that the stream is gone."""
        return CentralError(f"the log's stream {self.stream} {what}: this run can't continue")

    def _unreachable(self, error: Exception) -> LogUnreachable:
        servers = without_secrets(",".join(self.servers))
        return LogUnreachable(f"the log at {servers} {explanation(self.servers, error)}")
