"""Central under hostile clients: a small robot works, and several connections send anything.

Each step does what the server does: it unpacks the bytes, handles their items, and packs, records
and logs the effects. There must be no exception, and the invariants must hold after each step. A
module must be able to read central's packets, and a reader of journals central's entries. A second
central gets the same bytes, and sometimes restarts from an image of itself. Both centrals must have
the same effects.
"""

import io
import logging
import math
from collections.abc import Iterable
from typing import Any

import msgspec

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import Grammar, Pools, damaged
from dev.invariants import check_invariants
from tca_central.core import Central
from tca_central.events import (
    Arrived,
    ConfirmTasks,
    ConnectionId,
    ConnectionLost,
    Event,
    KeysChanged,
    PermissionsChanged,
    Record,
    Restarted,
    Tick,
    Transmit,
)
from tca_central.image.decoder import decode
from tca_central.image.encoder import can_encode, encode
from tca_central.inputs import events_of
from tca_central.shell.log_lines import LogLines
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, Opened
from tca_wire.journal.records import JournalReader, record
from tca_wire.packets import headers
from tca_wire.packets.codec import pack_item, unpack_to_module
from tca_wire.packets.headers import PROTOCOL_VERSION, Attach, Hello, Register, Send, Tap, ToCentral
from tca_wire.packets.parts import (
    Attachment,
    HandlerFormat,
    MessageFormat,
    RetryPolicy,
    WatchOptions,
)
from tca_wire.points import TaskId
from tca_wire.vocabulary import Condition, MessageClass

MOST_STEPS = 40
_HEADERS = tuple(kind for kind in ToCentral.__args__ if kind is not Hello)
_INT = '{"type":"integer"}'
_DECLARED = (
    MessageFormat("walk", MessageClass.GOAL, _INT),
    MessageFormat("move", MessageClass.COMMAND, _INT, _INT),
    MessageFormat("note", MessageClass.INFORM, _INT),
    MessageFormat("where", MessageClass.QUERY, _INT, _INT),
    MessageFormat("pose", MessageClass.BROADCAST, _INT),
    MessageFormat("all", MessageClass.MULTI_QUERY, _INT, _INT),
    MessageFormat("mode", MessageClass.VARIABLE, _INT),
    MessageFormat("recover", MessageClass.EXCEPTION, _INT),
    MessageFormat("look", MessageClass.POINT_MONITOR, _INT, "", ["where", "move"]),
    MessageFormat("watch", MessageClass.POLLING_MONITOR, _INT, "", ["where", "note"]),
    MessageFormat("guard", MessageClass.DEMON_MONITOR, _INT, "", ["", "move", "note"]),
    MessageFormat("lift", MessageClass.GOAL, _INT, retry=RetryPolicy(2, fallback="move")),
)
_NAMES = tuple(one.name for one in _DECLARED)
_RESOURCES = ("legs", "planner", "user", "eyes")
_KEYS = ("", "arm", "uid:1001", "*", "owner")
_FAILURES = ("", "slipped", "timeout", "module lost", "handler error")
# The connections: a module's own, such as "legs", and those of its slots, such as "legs/1".
LINES = (b"user", b"legs", b"legs/1", b"legs/2", b"planner", b"planner/1", b"new", b"newer")

_SILENT = logging.getLogger("fuzz")
_SILENT.disabled = True


def packed(*items: Any) -> bytes:
    """Return a packet of headers, or of pairs of a header and a body."""
    return b"".join(pack_item(*one) if isinstance(one, tuple) else pack_item(one) for one in items)


def beginning() -> list[tuple[bytes, bytes]]:
    """Return the packets with which the robot starts, each with its line."""
    declares = Register(2, list(_DECLARED))
    handlers_of = {
        b"legs": [HandlerFormat("move", "legs", "", 2), HandlerFormat("note", "legs")],
        b"planner": [
            HandlerFormat(name, "planner", "all")
            for name in ("walk", "where", "all", "pose", "mode", "recover")
        ],
    }
    packets = [(b"user", packed(_hello("user"), declares))]
    for module, handlers in handlers_of.items():
        name = module.decode()
        packets.append((module, packed(_hello(name), declares, Register(3, [], handlers))))
        packets.append((module + b"/1", packed(_hello(name, 1))))
    packets.append((b"legs/2", packed(_hello("legs", 2))))
    sends = [
        (Send(3 + number, name, TaskId(0)), b"\x07")
        for number, name in enumerate(("walk", "move", "where"))
    ]
    requests = (
        Attach(6, Attachment("", "recover")),
        Tap(7, Condition.BEFORE_HANDLING, "note", "move"),
        Send(8, "watch", watch=WatchOptions(period=1.0)),
        Send(9, "guard"),
    )
    packets.append((b"user", packed(*sends, *requests)))
    return packets


def _hello(module: str, connection: int = 0) -> Hello:
    resource = module if connection else ""
    return Hello(
        1,
        PROTOCOL_VERSION,
        module,
        f"run of {module}",
        connection,
        resource,
        "here:1",
        b"",
        8 * connection,
    )


class Attacked:
    """A central, and the work of the server around it."""

    def __init__(self) -> None:
        self.central = Central()
        self.outputs: list[bytes] = []
        """The packets and journal records of central, in order."""
        self._lines = LogLines(_SILENT, self.central)
        self._journal = io.BytesIO()
        self._journal.write(
            record(Entry(0, 0.0, [Opened(JOURNAL_VERSION, "test", 0, 0.0, "fuzz")]))
        )

    def arrive(self, time: float, line: bytes, packet: bytes, principal: str = "") -> None:
        """Let a packet arrive."""
        for event in events_of(Arrived(time, ConnectionId(line), packet, principal)):
            self.happen(event)

    def happen(self, event: Event) -> None:
        """Let an event happen."""
        for effect in self.central.handle(event):
            if isinstance(effect, Record):
                self.outputs.append(record(effect.entry))
                self._lines.write(effect)
            else:
                self.outputs.append(self._packed(effect))
        due = self.central.clock.next
        assert due is None or math.isfinite(due), f"a timer is due at {due}"

    def restore_from_image(self) -> None:
        """Replace central by a copy that is restored from central's image."""
        if can_encode(self.central):
            self.central = decode(encode(self.central))
            self._lines = LogLines(_SILENT, self.central)

    @staticmethod
    def _packed(effect: Transmit) -> bytes:
        packet = pack_item(effect.header, effect.body)
        assert unpack_to_module(packet) == [(effect.header, effect.body)], (
            "a module reads another packet"
        )
        return bytes(effect.connection) + packet

    def check_journal(self) -> None:
        """Check that a reader of journals reads every entry."""
        self._journal.writelines(one for one in self.outputs if one[:1] == b"\xce")
        entries = JournalReader(self._journal)
        read = sum(1 for _ in entries)
        unread = entries.torn + len(entries.holes) + entries.unknown
        assert read > 1 and not unread, "the journal has entries that can't be read"  # noqa: PT018


class Attack:
    """One attack, made of choices, on two centrals at once."""

    def __init__(self, choices: Choices) -> None:
        self._choices = choices
        self._attacked = Attacked(), Attacked()
        self._time = 0.0
        pools: Pools = {
            "number": self._numbers,
            "request": self._numbers,
            "requests": self._numbers,
            "origin": self._deliveries,
            "delivery": self._deliveries,
            "deliveries": self._deliveries,
            "task": self._tasks,
            "monitor": self._tasks,
            "parent": self._tasks,
            "id": self._ids,
            "message": lambda: _NAMES,
            "listener": lambda: _NAMES,
            "handler": lambda: _NAMES,
            "action": lambda: _NAMES,
            "messages": lambda: _NAMES,
            "promised": lambda: _NAMES,
            "of": lambda: _NAMES,
            "variable": lambda: ("mode",),
            "parts": lambda: _NAMES,
            "name": lambda: _NAMES,
            "data": lambda: (_INT,),
            "reply": lambda: (_INT, ""),
            "resource": lambda: _RESOURCES,
            "module": lambda: _RESOURCES,
            "failure": lambda: _FAILURES,
            "kinds": lambda: _FAILURES,
            "incarnation": lambda: [f"run of {name}" for name in _RESOURCES],
            "version": lambda: (PROTOCOL_VERSION,),
            "connection": lambda: (0, 1, 2),
            "prefetch": lambda: (0, 8),
            "keys": lambda: _KEYS,
            "modules": lambda: ("*", "legs", "us*"),
            "allowed": lambda: _KEYS,
            "revoked": lambda: _KEYS,
            "endpoint": lambda: ("ipc:///legs/2", "tcp://127.0.0.1:5"),
            "moment": lambda: (1, 2, 4, 8, 16, 32),
        }
        self._grammar = Grammar(choices, pools)
        self._last = b""
        for line, packet in beginning():
            self._send_to_both(line, packet)

    @property
    def central(self) -> Central:
        """The first of the two centrals."""
        return self._attacked[0].central

    def run(self) -> None:
        """Attack until no choices are left."""
        for _ in range(MOST_STEPS):
            if self._choices.is_over:
                break
            self._step()
            check_invariants(self.central)
        one, other = self._attacked
        assert one.outputs == other.outputs, "the same bytes had other effects"
        one.check_journal()

    def _step(self) -> None:
        choices = self._choices
        line, kind = choices.one_of(LINES), choices.below(16)
        self._time += choices.below(4) / 4
        if kind == 0:
            self._handle_in_both(ConnectionLost(self._time, ConnectionId(line)))
        elif kind == 1:
            self._time += choices.below(64)
            self._handle_in_both(Tick(self._time))
        elif kind == 2:
            self._send_to_both(line, choices.take(8 + choices.below(64)))
        elif kind == 3:
            self._send_to_both(line, self._last)
        elif kind == 4 and choices.once_in(2):
            self._attacked[1].restore_from_image()
        elif kind == 4:
            self._handle_in_both(self._admin_event())
        else:
            packet = packed(*self._items(line, 1 + choices.once_in(4)))
            self._send_to_both(line, damaged(packet, choices) if kind == 5 else packet)

    def _admin_event(self) -> Event:
        """Return an event that no client causes."""
        kind = self._choices.one_of(
            (ConfirmTasks, ConfirmTasks, KeysChanged, PermissionsChanged, Restarted)
        )
        if kind is Restarted:
            away, grace, hold = (self._choices.below(20) for _ in range(3))
            return Restarted(self._time, away, grace, hold % 2 == 1, self._choices.below(3) * 1000)
        made: Any = kind
        event: Event = msgspec.structs.replace(self._grammar.header(made), time=self._time)
        return event

    def _items(self, line: bytes, number: int) -> Iterable[tuple[Any, bytes]]:
        choices, grammar = self._choices, self._grammar
        for _ in range(number):
            if choices.once_in(12):
                header = grammar.header(Hello)
            elif choices.once_in(3) and (running := self._running_in(line)):
                delivery = choices.one_of(running)
                is_done = choices.below(3)
                header = (
                    headers.Reply(delivery)
                    if is_done
                    else headers.Fail(delivery, choices.one_of(_FAILURES))
                )
            else:
                header = grammar.header(choices.one_of(_HEADERS))
            yield header, choices.take(choices.below(6))

    def _send_to_both(self, line: bytes, packet: bytes) -> None:
        self._last = packet
        principal = self._choices.one_of(_KEYS) if self._choices.once_in(16) else ""
        for attacked in self._attacked:
            attacked.arrive(self._time, line, packet, principal)

    def _handle_in_both(self, event: Event) -> None:
        for attacked in self._attacked:
            attacked.happen(event)

    # --- what makes sense now ---------------------------------------------------------------------

    def _numbers(self) -> list[int]:
        last = max(
            (one.last_number for one in self.central.registry.connections.values()), default=0
        )
        return [last + 1, 0, last, *range(1, min(last, 12))] if last < 1 << 62 else [0]

    def _deliveries(self) -> list[int]:
        return [one.handling_id for one in self.central.dispatcher.running.values()] + [0]

    def _running_in(self, line: bytes) -> list[int]:
        running = self.central.dispatcher.running.values()
        return [one.handling_id for one in running if one.slot is not None and one.slot.id == line]

    def _tasks(self) -> list[int]:
        return [*self.central.tree.tasks, 0, -1, -3, -4, self.central.tree.newest]

    def _ids(self) -> list[int]:
        return [*self.central.attached, *self.central.taps, 0]


def attack(data: bytes) -> None:
    """Send headers, most of them plausible."""
    Attack(Choices(data)).run()


def attack_with_bytes(data: bytes) -> None:
    """Send raw packets.

    Before each packet, one byte names its line and two bytes its length.
    """
    one, other = Attacked(), Attacked()
    for attacked in (one, other):
        for line, packet in beginning():
            attacked.arrive(0.0, line, packet)
        choices, time = Choices(data), 0.0
        while not choices.is_over:
            time += 0.25
            line = choices.one_of(LINES)
            attacked.arrive(time, line, choices.take(int.from_bytes(choices.take(2))))
            check_invariants(attacked.central)
    assert one.outputs == other.outputs, "the same bytes had other effects"
    one.check_journal()


def seeds_of_bytes() -> list[bytes]:
    """Return the robot's own packets, as inputs of ``attack_with_bytes``."""
    whole = b"".join(
        bytes([LINES.index(line)]) + len(packet).to_bytes(2) + packet
        for line, packet in beginning()
    )
    return [whole, *(whole[:size] for size in range(0, len(whole), 300))]
