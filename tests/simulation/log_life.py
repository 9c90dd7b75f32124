"""A life of a town whose central is several members with a replicated log."""

import random
from collections.abc import Callable

from simulation.clockwork import Clockwork
from simulation.harbour import Harbour
from simulation.life import CHILD_OF_SEED, Life
from simulation.member import LogMember
from simulation.members import Members
from simulation.options import Options, drawn

from tca_central.shell.log_writer import Sync
from tca_wire.points import TaskId


def drawn_with_log(dice: random.Random) -> Options:
    """Draw faults and features of a life with a log."""
    options, choice = drawn(dice), dice.choice
    options.sync = Sync.ALWAYS  # the engine decides
    options.central_crashes /= 4  # there are more members, and more steps
    options.snapshots = choice((0.0, 0.02, 0.1))
    options.members = choice((2, 2, 3))
    options.log_delay = choice((0.0, 0.001, 0.02, 0.3))
    options.lost_requests = choice((0.0, 0.0, 0.01, 0.1))
    options.lost_answers = choice((0.0, 0.0, 0.01, 0.1))
    options.held_messages = choice((0.0, 0.0, 0.01))
    options.deaths = choice((0.0, 0.1, 0.3))
    options.pauses = choice((0.0, 0.1, 0.5))
    options.outages = choice((0.0, 0.0, 0.1))
    options.log_cuts = choice((0.0, 0.0, 0.2))
    options.orders = choice((0.0, 0.0, 0.3))
    options.patience = choice((2.0, 15.0))
    options.piece_bytes = choice((500, 5000, 512 << 10))
    return options


class LogLife(Life):
    """The life of a town, determined by its seed."""

    def __init__(
        self,
        seed: int,
        options: Options | None = None,
        write_trace: Callable[[str], None] | None = None,
    ) -> None:
        if options is None:
            options = drawn_with_log(Clockwork(seed ^ CHILD_OF_SEED).dice)
        super().__init__(seed, options, write_trace)

    def build_central(self) -> None:
        """Make the lines and the members."""
        self.network = Harbour(self.clockwork, self.options, self.options.members)
        self.daemon = self.members = Members(
            self.clockwork, self.network, self.options, self.outside.publish, self._count
        )

    def _count(self, what: str) -> None:
        self.outside.counts[what] += 1

    def _plan_faults(self) -> None:
        super()._plan_faults()
        options, clockwork = self.options, self.clockwork
        for rate, fault in (
            (options.deaths, self._kill),
            (options.pauses, self._freeze),
            (options.outages, self._stop_engine),
            (options.log_cuts, self._cut),
            (options.orders, self._order),
        ):
            at = 1.0
            while rate:
                at += clockwork.dice.expovariate(rate)
                if at > options.seconds:
                    break
                clockwork.after(at, fault)

    def _any(self) -> LogMember | None:
        running = [one for one in self.members.members if one.is_running]
        return self.clockwork.dice.choice(running) if running else None

    def _kill(self) -> None:
        if (member := self._any()) is not None:
            member.kill()

    def _freeze(self) -> None:
        if (member := self._any()) is not None:
            member.freeze(self.clockwork.dice.choice((0.2, 1.1, 1.5, 3.0, 8.0)))

    def _stop_engine(self) -> None:
        seconds = self.clockwork.dice.choice((0.5, 1.5, 5.0, 20.0))
        self.clockwork.trace("engine", f"does not answer for {seconds} s")
        self.members.engine.down_until = self.clockwork.now + seconds

    def _cut(self) -> None:
        if (member := self._any()) is not None and member.way is not None:
            seconds = self.clockwork.dice.choice((0.5, 1.5, 5.0, 20.0))
            self.clockwork.trace(member.name, f"can't reach the engine for {seconds} s")
            member.way.cut_until = self.clockwork.now + seconds

    def _order(self) -> None:
        if (member := self._any()) is not None and member.member is not None:
            self.clockwork.trace(member.name, "is asked to lead")
            member.member.lead_now()

    def _suspended(self) -> list[TaskId]:
        core = self.daemon.core
        return [] if core is None else [TaskId(task) for task in core.tree.suspended]

    def _judge(self) -> None:
        super()._judge()
        self.outside.counts["moves"] += self.network.moves
        self.members.judge()
