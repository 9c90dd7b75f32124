"""The replicated log on NATS JetStream. One stream has one log.

Central's loop waits for each append: what follows from inputs must not leave before they are safe.
"""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Coroutine, Sequence
from itertools import count
from secrets import token_hex
from typing import Any

import msgspec
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
from nats.js.errors import NotFoundError

from tca_central.errors import CentralError
from tca_central.replication.jetstream_bodies import JetStreamBodies
from tca_central.replication.jetstream_connection import JetStreamConnection, WrongLast
from tca_central.replication.log_checks import check_stream, has_quorum
from tca_central.replication.shared_log import Deposed, Kind, Message, Sign

log = logging.getLogger("tca.central")

APPENDED_WITHIN = 0.3
"""Seconds after which an append is repeated. A standby takes over after one second of silence."""
LOST_AFTER = 30.0
"""Seconds for which the log must lack its last messages until they count as lost."""
SLOWEST = 1e6
"""Bytes a second of a slow network, to which an append has more time."""
SIGN_PERIOD = 0.25
"""Seconds between two signs of life."""
_BATCH = 64
"""Messages in a batch at most: a server cuts a client for which more than 64 MiB wait."""
_READ_PERIOD = 0.05
"""Seconds between two reads, unless much is waiting: a read costs more than its messages."""
_NO_STREAM = 10059
_KIND, _PART, _MORE, _WRITER = "Tca-Kind", "Tca-Part", "Tca-More", "Tca-Writer"
_EXPECTED = "Nats-Expected-Last-Sequence"

_encode_sign = msgspec.json.Encoder().encode
_decode_sign = msgspec.json.Decoder(Sign).decode


class JetStreamLog:
    """A log in a stream of NATS. Once it is open, each call waits until the log answers.

    Args:
        servers: Addresses of the servers, ``nats://host:port``.
        name: The name of the log. Each robot has its own.
    """

    def __init__(self, servers: Sequence[str], name: str) -> None:
        self.name, self._subject = name, f"tca.{name}"
        self._replicas = min(len(servers), 5)
        self._line = JetStreamConnection(servers, f"TCA-{name}")
        self._line.on_connected = self._listen
        self._bodies = JetStreamBodies(self._line, self._subject)
        #: The same with a connection of its own, for a thread beside that of this log.
        self._bodies_beside: JetStreamBodies | None = None
        self._thread = threading.get_ident()
        self._writer, self._serials = token_hex(8), count()
        self._sign: Sign | None = None
        self._signs: dict[str, tuple[float, Sign]] = {}
        self._reader: JetStreamContext.PullSubscription | None = None
        self._read_to = 0  #: the last message that the reader has returned
        self._next_read = 0.0  #: when to read again, at the earliest
        self._stamp = 0.0  #: when the log got that message, in seconds since 1970
        self._begun: set[asyncio.Task[None]] = set()
        try:
            self._line.call(self._open())
        except BaseException:
            self._line.close()
            raise

    @property
    def gives_up(self) -> Callable[[], bool]:
        """Whether calls fail that wait for the log, because this program must end."""
        return self._line.gives_up

    @gives_up.setter
    def gives_up(self, gives_up: Callable[[], bool]) -> None:
        self._line.gives_up = gives_up

    def _gives_up_now(self) -> bool:
        return self._line.gives_up()

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
        # One after the other: a later piece alone might follow another central's message, and so
        # depose that central.
        for number, data in enumerate(pieces):
            follows = is_more or number + 1 < len(pieces)
            message = Message(after + number + 1, kind, data, part + number, follows)
            self._line.call(self._append(message))
        return after + len(pieces)

    def read(self, after: int, seconds: float) -> list[Message]:
        """Return messages that follow *after*. See ``SharedLog``."""
        return self._line.call(self._read(after, seconds))

    def last(self) -> int:
        """Return the number of the last message. See ``SharedLog``."""
        return int(self._line.call(self._line.until_answered(self._last_sequence)))

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
        return [(now - at, sign) for at, sign in self._signs.values()]

    def put_body(self, name: str, data: bytes) -> None:
        """Store a large body. See ``SharedLog``. One thread beside that of this log may call it."""
        bodies = self._bodies
        if threading.get_ident() != self._thread:
            if self._bodies_beside is None:
                line = JetStreamConnection(self._line.servers, self._line.stream)
                line.gives_up = self._gives_up_now
                line.call(line.open())
                line.is_open = True
                self._bodies_beside = JetStreamBodies(line, self._subject)
            bodies = self._bodies_beside
        bodies.line.call(bodies.put(name, data))

    def body(self, name: str) -> bytes | None:
        """Return a large body; None if it is missing or incomplete."""
        return self._line.call(self._bodies.get(name))

    def remove_body(self, name: str) -> None:
        """Remove a large body, soon or never."""
        self._begin(self._bodies.remove(name))

    def bodies(self) -> list[str]:
        """Return the names of all large bodies."""
        return self._line.call(self._bodies.names())

    def close(self) -> None:
        """Give no more signs, and disconnect."""
        if self._bodies_beside is not None:
            self._bodies_beside.line.close()
        self._line.close(self._begun)

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Begin work that continues during later calls. ``close`` waits for it."""
        task = self._line.begin(work)
        self._begun.add(task)
        task.add_done_callback(self._begun.discard)

    # --- while a call waits -----------------------------------------------------------------------

    async def _open(self) -> None:
        await self._line.open()
        await self._line.until_answered(self._find_stream)
        await self._bodies.open(self._replicas)
        self._line.note_answer()
        self._line.begin(self._give_signs())
        self._line.is_open = True

    async def _listen(self) -> None:
        await self._line.client.subscribe(f"{self._subject}.signs", cb=self._note_sign)

    async def _find_stream(self) -> None:
        subject, api, stream = f"{self._subject}.log", self._line.api, self._line.stream
        try:
            info = await api.stream_info(stream)
        except NotFoundError:
            info = await api.add_stream(
                StreamConfig(
                    name=stream,
                    subjects=[subject],
                    storage=StorageType.FILE,
                    num_replicas=self._replicas,
                    allow_direct=False,  # a follower of the stream might answer with an old state
                )
            )
        if warning := check_stream(info.config, subject, len(self._line.servers)):
            log.warning("%s", warning)

    async def _append(self, one: Message) -> None:
        """Append a message. It keeps its mark, since an attempt without an answer may succeed."""
        mark = f"{self._writer} {next(self._serials)}"
        headers = {_KIND: str(one.kind), _WRITER: mark, _EXPECTED: str(one.sequence - 1)}
        if one.part:
            headers[_PART] = str(one.part)
        if one.is_more:
            headers[_MORE] = "1"
        start = time.monotonic()
        while True:
            try:
                await self._line.until_answered(self._publish, one.data, headers, since=start)
            except WrongLast as error:
                if await self._is_appended(one.sequence, mark, start):
                    break
                # The servers expect the next number while they are too few to store this one.
                await self._line.pause(start, error)
            else:
                break
        self._line.note_answer()

    async def _is_appended(self, sequence: int, mark: str, start: float) -> bool:
        """Whether an earlier attempt, whose answer was lost, has appended a message.

        It may do so later. Raises Deposed if another writer's message is there.
        """
        line = self._line
        info = await line.until_answered(line.api.stream_info, line.stream, since=start)
        found = await line.until_answered(self._message, sequence, since=start)
        if found is not None and (found.headers or {}).get(_WRITER) == mark:
            return True
        last = info.state.last_seq
        if found is not None or last >= sequence:  # or it was removed
            msg = "another central leads: it has written to the log"
            raise Deposed(msg)
        if last < sequence - 1 and has_quorum(info) and time.monotonic() > start + LOST_AFTER:
            raise line.lost("has lost messages")
        return False

    async def _publish(self, piece: bytes, headers: dict[str, str]) -> None:
        within = APPENDED_WITHIN + len(piece) / SLOWEST
        await self._line.api.publish(f"{self._subject}.log", piece, timeout=within, headers=headers)

    async def _message(self, sequence: int) -> "RawStreamMsg | None":
        try:
            return await self._line.api.get_msg(self._line.stream, sequence)
        except NotFoundError as error:
            if error.err_code == _NO_STREAM:
                raise self._line.lost("was deleted") from None
            return None  # removed by another writer, or not there yet

    async def _read(self, after: int, seconds: float) -> list[Message]:
        line, start = self._line, time.monotonic()
        until = start + seconds
        while True:
            try:
                messages = await self._fetch(after, max(0.01, until - time.monotonic()))
            except TimeoutError as error:
                problem: Exception = error
                last = await self._last()
                if last is not None:
                    line.note_answer()
                    if last > after:
                        self._reader = None  # it has missed messages
                    elif time.monotonic() >= until:
                        return []
                    start = time.monotonic()
            except (NatsError, OSError) as error:
                self._reader, problem = None, error
            else:
                line.note_answer()
                return messages
            if line.gives_up():
                return []
            await line.pause(start, problem)

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
            self._reader = await self._line.api.pull_subscribe(
                f"{self._subject}.log", stream=self._line.stream, config=config
            )
            self._read_to = after
        await asyncio.sleep(self._next_read - time.monotonic())
        raw = await self._reader.fetch(_BATCH, seconds)
        if not raw:  # a server's remark has ended the wait
            raise TimeoutError
        if len(raw) < _BATCH:
            self._next_read = time.monotonic() + _READ_PERIOD
        fetched = [_read_message(one) for one in raw]
        first = fetched[0].sequence
        messages = [one for at, one in enumerate(fetched) if one.sequence == first + at]
        if first <= after or (first > after + 1 and await self._first() <= after + 1):
            self._reader = None  # its server or connection broke: it repeats or loses messages
            raise TimeoutError
        self._read_to = messages[-1].sequence
        self._stamp = raw[len(messages) - 1].metadata.timestamp.timestamp()
        return messages

    async def _first(self) -> int:
        return int((await self._line.api.stream_info(self._line.stream)).state.first_seq)

    async def _last_sequence(self) -> int:
        return int((await self._line.api.stream_info(self._line.stream)).state.last_seq)

    async def _last(self) -> int | None:
        """Return the number of the last message; None if the log does not answer."""
        try:
            info = await self._line.api.stream_info(self._line.stream)
            return int(info.state.last_seq) if has_quorum(info) else None
        except (TimeoutError, NatsError, OSError):
            return None

    async def _remove(self, before: int) -> None:
        with contextlib.suppress(NatsError, asyncio.TimeoutError, OSError):
            await self._line.api.purge_stream(self._line.stream, seq=before)

    async def _note_sign(self, message: Any) -> None:
        with contextlib.suppress(msgspec.MsgspecError):
            sign = _decode_sign(message.data)
            self._signs[sign.member] = time.monotonic(), sign

    async def _give_signs(self) -> None:
        while True:
            if self._sign is not None:
                with contextlib.suppress(NatsError, OSError):
                    await self._line.client.publish(
                        f"{self._subject}.signs", _encode_sign(self._sign)
                    )
            await asyncio.sleep(SIGN_PERIOD)


def _read_message(raw: Any) -> Message:
    headers = raw.headers or {}
    try:
        kind = Kind(headers.get(_KIND, ""))
    except ValueError:
        msg = (
            f"message {raw.metadata.sequence.stream} of the log is not central's: "
            f"delete the stream {raw.metadata.stream}, or choose another NAME in nats://.../NAME"
        )
        raise CentralError(msg) from None
    part = int(headers.get(_PART, 0))
    return Message(raw.metadata.sequence.stream, kind, raw.data, part, _MORE in headers)
