"""The faults and features of a life. Each seed draws them."""

import random

import msgspec

from tca_central.shell.log_writer import Sync


class Options(msgspec.Struct):
    """The faults and features of a life. Rates are per second; chances per occasion."""

    seconds: float = 15.0
    """The time with faults."""
    delay: float = 0.02
    """The longest time that a packet takes."""
    breaks: float = 0.0
    half_open: float = 0.0
    """The longest time for which central does not notice a broken line."""
    crashes: float = 0.0
    """The crash rate of modules."""
    leaves: float = 0.0
    """The rate at which modules leave and return."""
    central_crashes: float = 0.0
    """The chance of a crash at each step of central's turns. Steps lie before, within and after
    each write.
    """
    crash_at: int = 0
    """Crash at just this step of central's turns (0: by chance)."""
    power_cuts: float = 0.0
    """The chance that a crash of central also loses the bytes that were not synced."""
    full_disks: float = 0.0
    """The chance in each turn that the disk is about to fill. After each failure of central by the
    full disk, there may be room again.
    """
    sync: Sync = Sync.ALWAYS
    hold: bool = False
    """A restarted central starts no task until a module tells central to continue."""
    sees_processes: bool = False
    """A restarted central knows which processes have ended."""
    snapshots: float = 0.0
    ids_again: bool = False
    """A restarted central counts routing ids from the beginning."""
    away: float = 2.0
    """The longest time for which a crashed central, or a crashed module, is away."""
    trusts_all: bool = False
    """Every slot gets prefetched messages."""
    slow: float = 0.1
    """The longest time that a handler takes."""
    users: int = 2
    actions: int = 8
    """The number of actions of each user."""
    failures: float = 0.0
    features: frozenset[str] = frozenset()
    checks_each: int = 8
    """The number of events between checks of central's invariants."""
    members: int = 0
    """The number of members with a replicated log (0: central has files)."""
    log_delay: float = 0.0
    """The longest time that a request to the log, or its answer, takes."""
    lost_requests: float = 0.0
    lost_answers: float = 0.0
    held_messages: float = 0.0
    """The chance that the engine stores a message later or never, and none before it."""
    deaths: float = 0.0
    """The rate at which members die."""
    pauses: float = 0.0
    """The rate at which members stand still for a while."""
    outages: float = 0.0
    """The rate at which the log's engine does not answer for a while."""
    log_cuts: float = 0.0
    """The rate at which a member can't reach the engine for a while."""
    orders: float = 0.0
    """The rate at which a person asks a standby to lead."""
    patience: float = 15.0
    """Seconds after which a member gives up the engine."""
    piece_bytes: int = 512 << 10
    """Bytes in one message of the log at most."""

    @property
    def is_lossy(self) -> bool:
        """Whether central may forget messages that it has acknowledged."""
        return self.power_cuts > 0 and self.sync is not Sync.ALWAYS


FEATURES = (
    "kill",
    "suspend",
    "lock",
    "tap",
    "monitor",
    "variable",
    "later",
    "recover",
    "informs",
    "many",
    "deadline",
    "keep",
)


def drawn(dice: random.Random) -> Options:
    """Draw some faults and some features. A life with few features tries each of them more often
    (swarm testing).
    """
    some = dice.random
    options = Options(
        seconds=dice.choice((4.0, 4.0, 8.0, 16.0)),
        delay=dice.choice((0.001, 0.01, 0.1, 1.0)),
        breaks=dice.choice((0.0, 0.0, 0.3, 1.0)),
        half_open=dice.choice((0.5, 4.0, 15.0)),
        crashes=dice.choice((0.0, 0.0, 0.2, 0.5)),
        leaves=dice.choice((0.0, 0.0, 0.0, 0.3)),
        central_crashes=dice.choice((0.0, 0.0, 0.001, 0.003, 0.01)),
        power_cuts=dice.choice((0.0, 0.0, 0.5, 1.0)),
        full_disks=dice.choice((0.0, 0.0, 0.0, 0.002)),
        snapshots=dice.choice((0.0, 0.005, 0.02)),
        ids_again=some() < 0.3,
        sync=Sync.ALWAYS if some() < 0.8 else Sync.BATCH,
        hold=some() < 0.1,
        sees_processes=some() < 0.5,
        away=dice.choice((0.5, 2.0, 6.0)),
        trusts_all=some() < 0.5,
        slow=dice.choice((0.0, 0.01, 0.3, 2.0)),
        users=dice.choice((1, 1, 2, 3)),
        actions=dice.choice((2, 4, 4, 8)),
        failures=dice.choice((0.0, 0.1, 0.3)),
        features=frozenset(one for one in FEATURES if some() < 0.5),
        checks_each=dice.choice((1, 16, 16, 64)),
    )
    if (
        options.is_lossy
    ):  # a forgotten release leaves a lock without a holder: dev/records/promises.md
        options.features -= {"lock"}
    return options
