"""A walk in figures, from its footsteps, its journal and the memory use of its programs."""

import hashlib
import math
import os
import resource
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

import msgspec

from robots.ambler_sim.geometry import distance
from robots.ambler_sim.messages import CALIBRATE, FAULT_BEGAN, MOVE_BODY, TRAVERSE_PATH
from robots.ambler_sim.modules.fault_injector import CENTRAL
from robots.ambler_sim.run.rules import FOOTFALL, PLANNED_AHEAD, RULES, STABILITY
from robots.ambler_sim.vocabulary import ORIGIN, Footstep
from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.rules import RULES as RULES_OF_TASKS
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_tools.journal.records import TaskState
from tca_wire.points import Moment

RECOVERIES = {
    "amplifier trip": ("switch on",),
    "stuck joint": ("free leg",),
    "motion fault": ("free leg",),
    "encoder drift": (CALIBRATE.name,),
    "force sensor": (CALIBRATE.name,),
    "no image": ("look again", "go on without image"),
    "bad image": ("look again", "go on without image"),
    "unseen rock": ("raise leg", "replan move"),
    "soft spot": ("level body",),
    "no footfall": ("plan otherwise", "replan move", "shuffle feet"),
    "lost module": (),
    "lost central": (),
}
"""For each kind of fault, the tasks that show a recovery. The loss of a program counts as recovered
at the next footstep.
"""

ROUND = 8
"""Footsteps within which a recovery counts for a fault: each leg moves, some more than once."""

CLASS = 0.05
"""The width of a class of slopes in the histogram."""

WARM_UP = 100.0
"""Metres after which a program's memory use is first measured. A measurement at least this many
metres later is compared with the first.
"""


@dataclass(frozen=True, slots=True)
class MemoryUse:
    """The memory use of programs at the end, in MB: of central, and of all.

    *fastest* is the program that grew fastest. *growth* (MB in 100 m) is the growth of that
    program; None after too short a walk.
    """

    central: float = 0.0
    all: float = 0.0
    growth: float | None = None
    fastest: str = ""

    def __str__(self) -> str:
        grew = (
            "" if self.growth is None else f", at most {self.growth:+.1f} in 100 m ({self.fastest})"
        )
        return f"{self.central:.0f} and {self.all:.0f} MB{grew}"


class Usage:
    """The memory use of programs during a walk. A restarted program counts as another one."""

    def __init__(self) -> None:
        self._samples: defaultdict[tuple[str, int], list[tuple[float, float]]] = defaultdict(list)
        """Pairs of metres walked and MB, by name and process."""
        self._running: tuple[tuple[str, int], ...] = ()

    def measure(self, metres: float, processes: Mapping[str, int]) -> None:
        """Measure the present memory use of these programs."""
        self._running = tuple(processes.items())
        for name, process in self._running:
            self._samples[name, process].append((metres, _megabytes(process)))

    def at_end(self) -> MemoryUse:
        """Return the memory use at the end of the walk, and its growth."""
        ends = {name: self._samples[name, process][-1][1] for name, process in self._running}
        growths = [(growth_of(samples), name) for (name, _), samples in self._samples.items()]
        known = [(growth, name) for growth, name in growths if growth is not None]
        return MemoryUse(
            ends.get(CENTRAL, 0.0), sum(ends.values()), *max(known, default=(None, ""))
        )


def growth_of(samples: Sequence[tuple[float, float]]) -> float | None:
    """Return a program's growth in MB per 100 m since its warm-up; None after too short a run."""
    last = samples[-1]
    warm = next((sample for sample in samples if sample[0] >= samples[0][0] + WARM_UP), last)
    metres = last[0] - warm[0]
    return 100 * (last[1] - warm[1]) / metres if metres >= WARM_UP else None


@dataclass(frozen=True, slots=True)
class FaultFigures:
    """For one kind of fault: how many began, and how many were recovered from."""

    injected: int
    recovered: int


@dataclass(frozen=True, slots=True)
class RuleFigures:
    """How many of the *number* applicable rules the walk kept, with remarks on other rules."""

    kept: int
    number: int
    others: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.kept} of {self.number}"


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a walk. Lengths in m, angles in degrees, times in s, memory in MB."""

    footsteps: int
    way: float
    steepest: float
    slopes: dict[str, int]
    most_tilt: float
    least_margin: float
    error: float
    faults: dict[str, FaultFigures]
    operator_calls: int
    recoveries: dict[str, int]
    checked_before: float
    checked_after: float
    planned_ahead: float
    rules: RuleFigures
    wall: float
    cpu: float
    load: float
    memory: MemoryUse
    digest: str

    def lines(self) -> list[str]:
        """Return the figures as text."""
        share = self.error / self.way if self.way else 0.0
        slopes = ", ".join(f"{count} x {rise}" for rise, count in self.slopes.items())
        faults = [
            f"{each.recovered} of {each.injected} {kind}"
            for kind, each in sorted(self.faults.items())
        ]
        fault_counts = ", ".join(faults) or "none occurred"
        footsteps = f"{self.footsteps} footsteps, {self.way:.1f} m"
        margin = f"least stability margin {self.least_margin:.2f} m"
        checks = (
            f"checked before: {self.checked_before:.0%} of moves;"
            f" after: {self.checked_after:.0%} of leg moves"
        )
        effort = f"{self.wall:.0f} s, {self.cpu:.0f} s of processor, load {self.load:.1f}"
        return [
            f"{footsteps}; error of dead reckoning {self.error:.2f} m ({share:.1%})",
            f"slopes under the path up to {self.steepest:.1%}: {slopes}",
            f"greatest tilt {self.most_tilt:.2f} degrees, {margin}",
            f"faults recovered: {fault_counts}; operator calls: {self.operator_calls}",
            f"{checks}; planned during the step before: {self.planned_ahead:.0%} of steps",
            f"{effort}; memory of central and of all programs {self.memory}",
            f"rules kept: {self.rules}",
            *(f"  {other}" for other in self.rules.others),
            f"footsteps' digest {self.digest}",
        ]


def figures_of(record: Path, journal: Path, usage: Usage, wall: float) -> Figures:
    """Return the figures of a walk whose programs have ended and that took *wall* seconds."""
    history = History()
    checked = CheckedRun.of(open_log(journal), RULES, history)
    written = record.read_bytes() if record.exists() else b""
    steps = _footsteps(written)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    repairs = {"call operator", "do again", *chain.from_iterable(RECOVERIES.values())}
    recoveries = Counter(
        task.name
        for task in history.tasks.values()
        if task.name in repairs and task.state is TaskState.ACHIEVED
    )
    last = steps[-1] if steps else None
    return Figures(
        footsteps=len(steps),
        way=sum(distance(a, b) for a, b in pairwise([ORIGIN, *(step.true_pose for step in steps)])),
        steepest=max((step.slope for step in steps), default=0.0),
        slopes=_histogram([step.slope for step in steps]),
        most_tilt=math.degrees(max((step.tilt for step in steps), default=0.0)),
        least_margin=min((step.margin for step in steps), default=math.nan),
        error=distance(last.pose, last.true_pose) if last else 0.0,
        faults=_faults(history),
        operator_calls=recoveries["call operator"],
        recoveries=dict(recoveries),
        checked_before=STABILITY.count(history).share,
        checked_after=FOOTFALL.count(history).share,
        planned_ahead=PLANNED_AHEAD.count(history).share,
        rules=_rules(checked),
        wall=wall,
        cpu=children.ru_utime + children.ru_stime,
        load=os.getloadavg()[0],
        memory=usage.at_end(),
        digest=hashlib.sha256(written).hexdigest()[:16],
    )


def _megabytes(process: int) -> float:
    """Return the memory use of a process in MB; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * resource.getpagesize() / 1e6


def _footsteps(written: bytes) -> list[Footstep]:
    """Read the lines that the controller has written. The last line of each number counts."""
    steps = (msgspec.json.decode(line, type=Footstep) for line in written.splitlines())
    return list({step.number: step for step in steps}.values())


def _faults(history: History) -> dict[str, FaultFigures]:
    """For each kind of fault, how many began and how many were recovered from.

    The loss of a program counts as recovered at the robot's next footstep or arrival.
    """
    began, repair_starts = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list)
    step_ends = []
    for message in history.messages.values():
        if message.name == FAULT_BEGAN.name:
            began[FAULT_BEGAN.decode_data(message.body).kind].append(message.received)
    for task in history.tasks.values():
        if task.state is not TaskState.ACHIEVED or not task.handlings:
            continue
        repair_starts[task.name].append(task.handlings[0].start)
        if task.name in (MOVE_BODY.name, TRAVERSE_PATH.name):
            step_ends.append(task.time_of(Moment.END_ACHIEVING))
    step_ends.sort()
    figures = {}
    for kind, times in began.items():
        names = RECOVERIES[kind]
        repairs = sorted(chain.from_iterable(repair_starts[name] for name in names))
        count = recovered(times, repairs, step_ends) if names else walked_on(times, step_ends)
        figures[kind] = FaultFigures(len(times), count)
    return figures


def walked_on(losses: Sequence[float], steps: Sequence[float]) -> int:
    """Return the number of losses of a program (times) after which the robot has made another
    step.
    """
    return sum(loss < steps[-1] for loss in losses) if steps else 0


def recovered(faults: Sequence[float], recoveries: Sequence[float], steps: Sequence[float]) -> int:
    """Return the number of *faults* of one kind that were followed by a fitting recovery within a
    ROUND of footsteps.

    Each recovery counts for one fault. All arguments are times; recoveries and steps are sorted.
    """
    found = following = 0
    for fault in sorted(faults):
        last = bisect_right(steps, fault) + ROUND
        following = max(following, bisect_left(recoveries, fault))
        if following < len(recoveries) and recoveries[following] < (
            steps[last] if last < len(steps) else math.inf
        ):
            following += 1
            found += 1
    return found


def _rules(checked: CheckedRun) -> RuleFigures:
    number = len(RULES_OF_TASKS) + len(RULES)
    if not checked.is_whole:
        return RuleFigures(0, number, ("not checked: a part of the journal can't be read",))
    idle = [judge for judge in checked.unbroken if judge.why_vacuous]
    broken = {
        each.rule: f"broken: {each.rule}: {each.what}" for each in reversed(checked.violations)
    }
    vacuous = [f"did not apply to this walk: {judge.prop} ({judge.why_vacuous})" for judge in idle]
    kept = checked.rules_kept + len(checked.unbroken) - len(idle)
    return RuleFigures(kept, number - len(idle), (*reversed(broken.values()), *vacuous))


def _histogram(slopes: Sequence[float]) -> dict[str, int]:
    classes = Counter(int(slope / CLASS) for slope in slopes)
    return {
        f"{CLASS * number:.0%}-{CLASS * (number + 1):.0%}": classes[number]
        for number in sorted(classes)
    }
