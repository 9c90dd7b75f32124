"""A walk in figures: from the record of its footsteps, from its journal, and from what its programs used."""

import hashlib
import math
import os
import resource
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path

import msgspec

from robots.ambler_sim.messages import CALIBRATE, INJECT, LOSE_PROGRAM, MOVE_BODY
from robots.ambler_sim.run.losing import CENTRAL
from robots.ambler_sim.run.rules import FOOTFALL, PLANNED_AHEAD, RULES, STABILITY
from robots.ambler_sim.vocabulary import Footstep, Pose
from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.rules import RULES as RULES_OF_TASKS
from tca_tools.run.fold import History
from tca_tools.run.journals import open_log
from tca_tools.run.records import Task, TaskState
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
"""By which tasks it is seen that a fault was noticed and recovered from. After the loss of a program it is seen by the
next footstep.
"""

ROUND = 8
"""Footsteps within which a recovery belongs to a fault: each leg has moved meanwhile, and some were moved again."""

CLASS = 0.05
"""Of slopes, in the histogram."""


@dataclass(frozen=True, slots=True)
class MemoryUse:
    """What programs need, in MB: central, and all of them together."""

    central: float = math.nan
    all: float = math.nan

    def __str__(self) -> str:
        return f"{self.central:.0f} and {self.all:.0f} MB"


@dataclass
class Usage:
    """What programs need while the walk goes on, by metres walked."""

    memory: list[tuple[float, MemoryUse]] = field(default_factory=list)

    def look(self, metres: float, central: int, numbers: Iterable[int]) -> None:
        """Note what central's process and all of these (by their numbers) need now."""
        self.memory.append((metres, MemoryUse(_megabytes(central), sum(map(_megabytes, numbers)))))

    def at(self, share: float) -> MemoryUse:
        """At a share of the way."""
        way = share * self.memory[-1][0] if self.memory else math.inf
        return next((memory for metres, memory in self.memory if metres >= way), MemoryUse())


@dataclass(frozen=True, slots=True)
class FaultFigures:
    """Of one kind of faults: how many there were, and after how many the recovery was seen."""

    injected: int
    recovered: int


@dataclass(frozen=True, slots=True)
class RuleFigures:
    """How many rules a walk kept, of those of task-level control and its own, and what is to be said of the others."""

    kept: int
    number: int
    others: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.kept} of {self.number}"


@dataclass(frozen=True, slots=True)
class Figures:
    """What a walk was like. Lengths in m, angles in degrees, times in s, memory in MB."""

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
    memory_at_quarter: MemoryUse
    memory_at_end: MemoryUse
    digest: str

    def lines(self) -> list[str]:
        """For people."""
        share = self.error / self.way if self.way else 0.0
        slopes = ", ".join(f"{count} x {rise}" for rise, count in self.slopes.items())
        faults = [f"{each.recovered} of {each.injected} {kind}" for kind, each in sorted(self.faults.items())]
        return [
            f"{self.footsteps} footsteps, {self.way:.1f} m; reckoned place {self.error:.2f} m ({share:.1%}) off",
            f"slopes under the path up to {self.steepest:.1%}: {slopes}",
            f"greatest tilt {self.most_tilt:.2f} degrees, least stability margin {self.least_margin:.2f} m",
            f"faults recovered: {', '.join(faults) or 'none came'}; operator called {self.operator_calls} times",
            (
                f"moves checked before {self.checked_before:.0%}, leg moves after {self.checked_after:.0%}; "
                f"planned while the step before was walked {self.planned_ahead:.0%}"
            ),
            (
                f"{self.wall:.0f} s, {self.cpu:.0f} s of processor, load {self.load:.1f}; "
                f"central and all programs {self.memory_at_quarter} after a quarter, {self.memory_at_end} at the end"
            ),
            f"rules kept: {self.rules}",
            *(f"  {other}" for other in self.rules.others),
            f"footsteps' digest {self.digest}",
        ]


def figures_of(record: Path, journal: Path, usage: Usage, wall: float) -> Figures:
    """Of a walk whose programs have ended. *wall*: how long it took."""
    history = History()
    checked = CheckedRun.of(open_log(journal), RULES, history)
    steps = read_footsteps(record)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    tasks = list(history.tasks.values())
    recoveries = Counter(task.name for task in tasks if is_recovery(task) and task.state is TaskState.ACHIEVED)
    last = steps[-1] if steps else None
    return Figures(
        footsteps=len(steps),
        way=sum(_distance(a, b) for a, b in pairwise([Pose(0, 0, 0, 0), *(step.true_pose for step in steps)])),
        steepest=max((step.slope for step in steps), default=0.0),
        slopes=_histogram([step.slope for step in steps]),
        most_tilt=math.degrees(max((step.tilt for step in steps), default=0.0)),
        least_margin=min((step.margin for step in steps), default=math.nan),
        error=_distance(last.pose, last.true_pose) if last else 0.0,
        faults=_faults(tasks),
        operator_calls=recoveries["call operator"],
        recoveries=dict(recoveries),
        checked_before=STABILITY.count(history).share,
        checked_after=FOOTFALL.count(history).share,
        planned_ahead=PLANNED_AHEAD.count(history).share,
        rules=_rules(checked),
        wall=wall,
        cpu=children.ru_utime + children.ru_stime,
        load=os.getloadavg()[0],
        memory_at_quarter=usage.at(0.25),
        memory_at_end=usage.at(1.0),
        digest=hashlib.sha256(record.read_bytes() if record.exists() else b"").hexdigest()[:16],
    )


def _megabytes(process: int) -> float:
    """Of a process; 0 if there is none."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize() / 1e6
    except (OSError, IndexError):
        return 0.0


def read_footsteps(record: Path) -> list[Footstep]:
    """From the file that the controller has written; the last of each number counts."""
    if not record.exists():
        return []
    lines = record.read_bytes().splitlines()
    steps = (msgspec.json.decode(line, type=Footstep) for line in lines)
    return list({step.number: step for step in steps}.values())


def is_recovery(task: Task) -> bool:
    """Whether a task mended something."""
    names = {name for names in RECOVERIES.values() for name in names}
    return task.name in names or task.name in ("call operator", "do again")


def _faults(tasks: Sequence[Task]) -> dict[str, FaultFigures]:
    """For each kind, how many were injected, and of how many the recovery was seen."""
    injected, mended, steps = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list), []
    for task in tasks:
        began = task.handlings[0].start if task.handlings else math.inf
        match task.name:
            case INJECT.name:
                injected[INJECT.decode_data(task.body).kind].append(began)
            case LOSE_PROGRAM.name:
                injected["lost central" if LOSE_PROGRAM.decode_data(task.body) == CENTRAL else "lost module"].append(
                    began
                )
            case MOVE_BODY.name if task.state is TaskState.ACHIEVED:
                steps.append(task.time_of(Moment.END_ACHIEVING))
            case name if task.state is TaskState.ACHIEVED:
                mended[name].append(began)
    return {
        kind: FaultFigures(
            len(times), recovered(times, sorted(_times_of(RECOVERIES[kind], mended, steps)), sorted(steps))
        )
        for kind, times in injected.items()
    }


def _times_of(names: Sequence[str], mended: Mapping[str, list[float]], steps: Sequence[float]) -> Iterable[float]:
    """When recoveries of these names began; that from a lost program is the robot's next footstep."""
    return chain.from_iterable(mended.get(name, ()) for name in names) if names else steps


def recovered(faults: Sequence[float], recoveries: Sequence[float], steps: Sequence[float]) -> int:
    """How many of the *faults* of one kind were followed by a fitting recovery before the next of that kind, and
    within a ROUND of footsteps. All are times; recoveries and steps are sorted.
    """
    found = 0
    for fault, following in pairwise((*sorted(faults), math.inf)):
        last = bisect_right(steps, fault) + ROUND
        until = min(following, steps[last] if last < len(steps) else math.inf)
        first = bisect_left(recoveries, fault)
        found += first < len(recoveries) and recoveries[first] < until
    return found


def _rules(checked: CheckedRun) -> RuleFigures:
    number = len(RULES_OF_TASKS) + len(RULES)
    if not checked.is_whole:
        return RuleFigures(0, number, ("not judged: a part of the journal can't be read",))
    idle = [judge for judge in checked.unbroken if judge.vacuous]
    broken = {each.rule: f"broken: {each.rule}: {each.what}" for each in reversed(checked.violations)}
    others = (*reversed(broken.values()), *(f"says nothing: {judge.stated}: {judge.vacuous}" for judge in idle))
    return RuleFigures(checked.rules_kept + len(checked.unbroken) - len(idle), number, others)


def _histogram(slopes: Sequence[float]) -> dict[str, int]:
    classes = Counter(int(slope / CLASS) for slope in slopes)
    return {f"{CLASS * number:.0%}-{CLASS * (number + 1):.0%}": classes[number] for number in sorted(classes)}


def _distance(a: Pose, b: Pose) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)
