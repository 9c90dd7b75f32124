"""The facts about a run as a whole: its start, its ends, and its journal. See facts.py."""

from tca_wire.journal.fact import BaseFact


class Opened(BaseFact, frozen=True, tag="opened"):
    """A segment starts. The times of its entries count from *began*, in seconds since 1970."""

    version: int
    epoch: str
    segment: int
    began: float
    central: str


class Shortened(BaseFact, frozen=True, tag="shortened"):
    """Facts about tasks and messages that had ended before the time *until* were removed."""

    until: float


class Closed(BaseFact, frozen=True, tag="closed"):
    """Central ended normally."""

    why: str


class CentralFailed(BaseFact, frozen=True, tag="broke"):
    """Central ended by an internal error. If the run continues, the fact "restarted" follows."""

    why: str


class CentralRestarted(BaseFact, frozen=True, tag="restarted"):
    """Central was down. No task starts until the awaited connections are back or lost."""

    away: float
    """The wall-clock seconds that it was down (0: not known)."""
    awaited: int
    """The number of awaited connections."""
    hold: bool = False
    """Tasks start only when a module allows it."""
    may_lack: bool = False
    """The last inputs before a power cut may be missing."""
    aside: int = 0
    """The number of journal entries of these inputs; they were set aside."""


class WentOn(BaseFact, frozen=True, tag="went on"):
    """Tasks start again after a restart: no connection is awaited, or module *by* asked for it."""

    by: str = ""


class CentralEnding(BaseFact, frozen=True, tag="ending"):
    """A module ended central. With *keep* the run continues at the next start."""

    by: str
    keep: bool


class MembersChanged(BaseFact, frozen=True, tag="members"):
    """The centrals with the same replicated log: *leader* leads, *standbys* follow.

    All are processes, as "host:pid".
    """

    leader: str
    standbys: list[str]
    behind: list[str]
    """The standbys that have not read the log's last seconds."""


class DiskSpace(BaseFact, frozen=True, tag="disk"):
    """The journal's disk is nearly full (*is_low*), so new tasks are refused; or has room again."""

    is_low: bool
