"""The replicated log on NATS JetStream. One stream has one log.

The client library of NATS is asynchronous, so that it runs in a thread of its own. Central's loop
waits for each append: what follows from inputs must not leave before they are safe.
"""

import asyncio
import contextlib
import threading
import time
from collections.abc import Coroutine, Sequence
from concurrent.futures import Future, wait
from itertools import count
from secrets import token_hex
from typing import Any, NamedTuple, TypeVar

import msgspec
import nats
from nats.aio.client import Client
from nats.errors import Error as NatsError
from nats.js import JetStreamContext
from nats.js.api import (
    AckPolicy,
    ConsumerConfig,
    DeliverPolicy,
    RawStreamMsg,
    StorageType,
    StreamConfig,
)
from nats.js.errors import BadRequestError, NotFoundError

from tca_central.errors import CentralError
from tca_central.replication.jetstream_bodies import JetStreamBodies
from tca_central.replication.shared_log import (
    Deposed,
    Kind,
    LogUnreachable,
    Message,
    Sign,
)

SIGN_PERIOD = 0.25
"""Seconds between two signs of life."""
PATIENCE = 15.0
"""Seconds to wait for the log. It elects another leader within about six."""
_REPLY_WITHIN = 1.0
_BATCH = 500
_WRONG_LAST = 10071
_KIND, _PART, _MORE, _WRITER = "Tca-Kind", "Tca-Part", "Tca-More", "Tca-Writer"
_EXPECTED = "Nats-Expected-Last-Sequence"

T = TypeVar("T")
_encode_sign = msgspec.json.Encoder().encode
_decode_sign = msgspec.json.Decoder(Sign).decode


class JetStreamLog:
    """A log in a stream of NATS.

    Args:
        servers: Addresses of the servers, ``nats://host:port``.
        name: The name of the log. Each robot has its own.
    """

    def __init__(self, servers: Sequence[str], name: str) -> None:
        self._servers, self._stream, self._subject = list(servers), f"TCA-{name}", f"tca.{name}"
        self._replicas = min(len(self._servers), 5)
        self._writer, self._serials = token_hex(8), count()
        self._sign: Sign | None = None
        self._signs: dict[str, tuple[float, Sign]] = {}
        self._reader: JetStreamContext.PullSubscription | None = None
        self._read_to = 0  #: the last message that the reader has returned
        self._stamp = 0.0  #: when the log got that message, in seconds since 1970
        self._begun: set[Future[None]] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="log", daemon=True)
        self._thread.start()
        self._nats: Client
        self._stream_api: JetStreamContext
        try:
            self._call(self._open())
        except BaseException:
            self._end_loop()
            raise

    def append(
        self,
        kind: Kind,
        pieces: Sequence[bytes],
        after: int,
        *,
        part: int = 0,
        is_more: bool = False,
    ) -> int:
        """Append pieces of a record after message *after*. See ``SharedLog``."""
        messages = [
            _Appended(kind, data, part + number, is_more or number + 1 < len(pieces))
            for number, data in enumerate(pieces)
        ]
        return self._call(self._append(messages, after))

    def read(self, after: int, seconds: float) -> list[Message]:
        """Return messages that follow *after*. See ``SharedLog``."""
        return self._call(self._read(after, seconds))

    def remove(self, before: int) -> None:
        """Remove the messages before a number, soon or never."""
        self._begin(self._remove(before))

    def age(self) -> float:
        """Return the seconds since the last message that was read, by the clock of the servers."""
        return max(0.0, time.time() - self._stamp) if self._stamp else 0.0

    def give_sign(self, sign: Sign | None) -> None:
        """Give this sign of life from now on; None: give no more."""
        self._sign = sign

    def signs(self) -> list[tuple[float, Sign]]:
        """Return each follower's last sign of life, and the seconds since then."""
        now = time.monotonic()
        return [(now - at, sign) for at, sign in self._signs.copy().values()]

    def put_body(self, name: str, data: bytes) -> None:
        """Store a large body. See ``SharedLog``."""
        self._call(self._bodies.put(name, data))

    def body(self, name: str) -> bytes | None:
        """Return a large body; None if it is missing or incomplete."""
        return self._call(self._bodies.get(name))

    def remove_body(self, name: str) -> None:
        """Remove a large body, soon or never."""
        self._begin(self._bodies.remove(name))

    def bodies(self) -> list[str]:
        """Return the names of all large bodies."""
        return self._call(self._bodies.names())

    def close(self) -> None:
        """Give no more signs, and disconnect."""
        wait(self._begun, PATIENCE)
        with contextlib.suppress(CentralError):
            self._call(self._close())
        self._end_loop()

    def _call(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Do this in the background. ``close`` waits for it."""
        self._begun.add(asyncio.run_coroutine_threadsafe(work, self._loop))
        self._begun = {one for one in self._begun if not one.done()}

    def _end_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    # --- in the thread of the loop ----------------------------------------------------------------

    async def _open(self) -> None:
        async def ignore(_: Exception) -> None:
            """Errors come back from the calls that they concern."""

        try:
            self._nats = await nats.connect(
                self._servers,
                error_cb=ignore,
                max_reconnect_attempts=-1,
                reconnect_time_wait=0.1,
                connect_timeout=1,
                ping_interval=1,
                max_outstanding_pings=2,
            )
        except (NatsError, OSError) as error:
            raise self._unreachable(error) from None
        self._stream_api = self._nats.jetstream(timeout=_REPLY_WITHIN)
        await self._until_answered(self._find_stream)
        await self._nats.subscribe(f"{self._subject}.signs", cb=self._note_sign)
        self._bodies = JetStreamBodies(
            self._stream_api, self._stream, self._subject, self._until_answered
        )
        await self._bodies.open(self._replicas)
        self._signing = self._loop.create_task(self._give_signs())

    async def _find_stream(self) -> None:
        try:
            await self._stream_api.stream_info(self._stream)
        except NotFoundError:
            await self._stream_api.add_stream(
                StreamConfig(
                    name=self._stream,
                    subjects=[f"{self._subject}.log"],
                    storage=StorageType.FILE,
                    num_replicas=self._replicas,
                    allow_direct=False,  # a follower of the stream might answer with an old state
                )
            )

    async def _until_answered(self, work: Any, *args: Any) -> Any:
        """Repeat a call until the log answers. Raises LogUnreachable."""
        until = time.monotonic() + PATIENCE
        while True:
            try:
                return await work(*args)
            except NotFoundError:
                raise
            except (TimeoutError, NatsError, OSError) as error:
                if isinstance(error, BadRequestError) and error.err_code == _WRONG_LAST:
                    raise
                if time.monotonic() > until:
                    raise self._unreachable(error) from None
            await asyncio.sleep(0.05)

    def _unreachable(self, error: Exception) -> LogUnreachable:
        why = str(error) or type(error).__name__
        return LogUnreachable(
            f"the log at {','.join(self._servers)} does not answer ({why}): "
            "more than half of its servers must run"
        )

    async def _append(self, messages: Sequence["_Appended"], after: int) -> int:
        # One after the other: a later piece alone might follow another central's message, and so
        # depose that central.
        for number, one in enumerate(messages):
            await self._append_one(one, after + number)
        return after + len(messages)

    async def _append_one(self, one: "_Appended", after: int) -> None:
        mark = f"{self._writer} {next(self._serials)}"
        headers = {_KIND: str(one.kind), _WRITER: mark, _EXPECTED: str(after)}
        if one.part:
            headers[_PART] = str(one.part)
        if one.is_more:
            headers[_MORE] = "1"
        until = time.monotonic() + PATIENCE
        while True:
            try:
                await self._until_answered(self._publish, one.data, headers)
            except BadRequestError as error:
                if time.monotonic() > until:
                    raise self._unreachable(error) from None
                if await self._is_appended(after + 1, mark):
                    return
                await asyncio.sleep(0.05)
            else:
                return

    async def _is_appended(self, sequence: int, mark: str) -> bool:
        """Whether an earlier attempt, whose answer was lost, has appended a message.

        It may do so later: the servers expect its number while they are too few to store it. Raises
        Deposed if another writer's message is there.
        """
        info = await self._until_answered(self._stream_api.stream_info, self._stream)
        found = await self._until_answered(self._message, sequence)
        if found is not None and (found.headers or {}).get(_WRITER) == mark:
            return True
        if found is not None or info.state.last_seq >= sequence:  # or it was removed
            msg = "another central leads: it has written to the log"
            raise Deposed(msg)
        return False

    async def _publish(self, piece: bytes, headers: dict[str, str]) -> None:
        await self._stream_api.publish(f"{self._subject}.log", piece, headers=headers)

    async def _message(self, sequence: int) -> "RawStreamMsg | None":
        try:
            return await self._stream_api.get_msg(self._stream, sequence)
        except NotFoundError:  # removed by another writer
            return None

    async def _read(self, after: int, seconds: float) -> list[Message]:
        until, waits_until = time.monotonic() + seconds, time.monotonic() + PATIENCE
        while True:
            try:
                return await self._fetch(after, max(0.01, until - time.monotonic()))
            except TimeoutError:
                last = await self._last()
                if last is not None and last > after:
                    self._reader = None  # it has missed messages
                elif last is not None and time.monotonic() >= until:
                    return []
                problem: Exception = TimeoutError("no messages")
            except (NatsError, OSError) as error:
                self._reader, problem = None, error
            if time.monotonic() > waits_until:
                raise self._unreachable(problem) from None
            await asyncio.sleep(0.02)

    async def _fetch(self, after: int, seconds: float) -> list[Message]:
        if self._reader is None or self._read_to != after:
            config = ConsumerConfig(
                deliver_policy=DeliverPolicy.BY_START_SEQUENCE,
                opt_start_seq=after + 1,
                ack_policy=AckPolicy.NONE,
                inactive_threshold=30.0,
                mem_storage=True,
                num_replicas=1,
            )
            self._reader = await self._stream_api.pull_subscribe(
                f"{self._subject}.log", stream=self._stream, config=config
            )
            self._read_to = after
        fetched = await self._reader.fetch(_BATCH, seconds)
        if not fetched:
            raise TimeoutError
        messages = [_read_message(one) for one in fetched]
        self._read_to, self._stamp = (
            messages[-1].sequence,
            fetched[-1].metadata.timestamp.timestamp(),
        )
        return messages

    async def _last(self) -> int | None:
        try:
            return int((await self._stream_api.stream_info(self._stream)).state.last_seq)
        except (TimeoutError, NatsError, OSError):
            return None

    async def _remove(self, before: int) -> None:
        with contextlib.suppress(NatsError, asyncio.TimeoutError, OSError):
            await self._stream_api.purge_stream(self._stream, seq=before)

    async def _note_sign(self, message: Any) -> None:
        with contextlib.suppress(msgspec.MsgspecError):
            sign = _decode_sign(message.data)
            self._signs[sign.member] = time.monotonic(), sign

    async def _give_signs(self) -> None:
        while True:
            if self._sign is not None:
                with contextlib.suppress(NatsError, OSError):
                    await self._nats.publish(f"{self._subject}.signs", _encode_sign(self._sign))
            await asyncio.sleep(SIGN_PERIOD)

    async def _close(self) -> None:
        self._signing.cancel()
        with contextlib.suppress(NatsError, asyncio.TimeoutError, OSError):
            await asyncio.wait_for(self._nats.close(), 1.0)


class _Appended(NamedTuple):
    """A message to append."""

    kind: Kind
    data: bytes
    part: int
    is_more: bool


def _read_message(raw: Any) -> Message:
    headers = raw.headers or {}
    try:
        kind = Kind(headers.get(_KIND, ""))
    except ValueError:
        msg = f"message {raw.metadata.sequence.stream} of the log is not central's"
        raise CentralError(msg) from None
    part = int(headers.get(_PART, 0))
    return Message(raw.metadata.sequence.stream, kind, raw.data, part, _MORE in headers)
