"""What may happen in a life: each seed draws which faults there are, and how often."""

import random

import msgspec

from tca_central.shell.log_writer import Sync


class Options(msgspec.Struct):
    """Faults, and what is in the town. Rates are per second; chances per occasion."""

    seconds: float = 15.0
    """How long there are faults."""
    delay: float = 0.02
    """The longest time that a packet takes."""
    breaks: float = 0.0
    half_open: float = 0.0
    """For how long central may take a broken line for a good one."""
    crashes: float = 0.0
    """Of modules."""
    leaves: float = 0.0
    """Modules that end of their own will, and come again."""
    central_crashes: float = 0.0
    """The chance at each step of central's turn: before, within and after each write."""
    crash_at: int = 0
    """Crash at just this step of central's turns (0: by chance)."""
    power_cuts: float = 0.0
    """The chance that a crash of central loses what was not synced."""
    full_disks: float = 0.0
    """The chance in each turn that the disk is full from now on, until central has failed on it for
    a while.
    """
    sync: Sync = Sync.ALWAYS
    hold: bool = False
    """After a restart of central no task starts before somebody says so."""
    sees_processes: bool = False
    """A central that starts again knows which processes are gone."""
    snapshots: float = 0.0
    ids_again: bool = False
    """A new central counts routing ids from the beginning."""
    away: float = 2.0
    """The longest time that a crashed central, or module, is away."""
    trusts_all: bool = False
    """Messages go ahead to every slot."""
    slow: float = 0.1
    """The longest time that a handler takes."""
    users: int = 2
    actions: int = 8
    """Of each user."""
    failures: float = 0.0
    features: frozenset[str] = frozenset()
    checks_each: int = 8
    """Central's invariants are checked after one event in so many."""

    @property
    def is_lossy(self) -> bool:
        """Whether central may forget what it has acknowledged."""
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
    """Some faults and some features: what is left out gives the others more room (swarm
    testing).
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
    ):  # a release that central forgets leaves a lock that nobody has: docs/reliability.md
        options.features -= {"lock"}
    return options
