"""What a walk's journal says of its checks and recoveries, for people."""

from collections import Counter
from pathlib import Path

from robots.ambler_sim.reactions import FOOTFALL_CHECK, STABILITY_CHECK
from tca_tools.run.fold import History
from tca_tools.run.journals import open_log
from tca_wire.vocabulary import Role


def report(journal: Path) -> list[str]:
    """Two lines: the checks that were made, and what was done about failures."""
    tasks = History.until(open_log(journal)).tasks.values()
    checks = Counter(task.name for task in tasks if task.name in (STABILITY_CHECK.name, FOOTFALL_CHECK.name))
    failed = sum(bool(task.failure) for task in tasks if task.role is Role.LISTENER)
    recoveries = Counter(task.name for task in tasks if task.role is Role.EXCEPTION)
    return [
        f"checks: {_counted(checks)}; {failed or 'none'} failed" if checks else "checks: none",
        f"recoveries: {_counted(recoveries) or 'none'}",
    ]


def _counted(names: Counter[str]) -> str:
    return ", ".join(f"{count} x {name}" for name, count in names.items())
