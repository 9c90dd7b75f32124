"""The colours of tasks, by their state."""

from tca_tools.journal.fates import HANDLED, WATCHING
from tca_tools.journal.records import TaskState

LOOKS: dict[str, tuple[str, str]] = {
    TaskState.HELD: ("#ffffff", "bright_black"),
    TaskState.QUEUED: ("#fff3c4", "yellow"),
    TaskState.PLANNING: ("#e9d8fd", "magenta"),
    TaskState.PLANNED: ("#d6e4ff", "blue"),
    TaskState.HANDLING: ("#ffcf70", "cyan"),
    TaskState.ACHIEVING: ("#ffe4b0", "cyan"),
    WATCHING: ("#cdeef2", "cyan"),
    TaskState.ACHIEVED: ("#cfeccb", "green"),
    TaskState.RESOLVED: ("#e3e04f", "bright_yellow"),
    TaskState.RECOVERING: ("#ffc9a3", "bright_red"),
    TaskState.SUSPENDED: ("#e6e6c8", "yellow"),
    TaskState.ENDING: ("#e8c4c0", "bright_red"),
    TaskState.FAILED: ("#f28b82", "red"),
    HANDLED: ("#dfae3f", "yellow"),
    TaskState.KILLED: ("#d5d5d5", "red"),
}
"""The fill in a picture, and the colour on a terminal."""
