"""One life of a town: some time with faults, then time without faults, in which everything must
end. A broken promise raises Broken.
"""

from collections.abc import Callable
from typing import Any

from simulation.clockwork import Broken, Clockwork
from simulation.daemon import Daemon
from simulation.network import Network
from simulation.options import Options, drawn
from simulation.outside import Outside
from simulation.threads import Process, Program
from simulation.town import MODULES, Janitor, TownProgram, User
from tools.runs import OPENED, checked

from dev.invariants import check_invariants
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome

HEALED_WITHIN = 300.0
"""The limit, in seconds without faults, until everything must have ended."""
LAST_WORDS = 3.0
"""Seconds for the last packets to arrive."""
NEVER = float("inf")
CHILD_OF_SEED = 0x9E3779B97F4A7C15


class Life:
    """The life of a town, determined by its seed."""

    def __init__(
        self,
        seed: int,
        options: Options | None = None,
        write_trace: Callable[[str], None] | None = None,
    ) -> None:
        self.seed = seed
        self.clockwork = Clockwork(seed, write_trace=write_trace)
        self.options = (
            options if options is not None else drawn(Clockwork(seed ^ CHILD_OF_SEED).dice)
        )
        self.outside = Outside(self.clockwork, is_lossy=self.options.is_lossy)
        self.build_central()
        self.processes: dict[str, Process] = {}
        self.daemon.take_back = self.outside.take_back
        self.daemon.is_gone = self._is_gone
        self.started: dict[str, int] = {}
        self.is_healing = False
        self.crashes = 0
        self.programs: dict[str, Program] = {
            name: TownProgram(name, self.options, self.outside) for name in MODULES
        }
        for number in range(self.options.users):
            self.programs[f"user{number}"] = User(f"user{number}", self.options, self.outside)

    def build_central(self) -> None:
        """Make the lines and central."""
        self.network: Any = Network(self.clockwork, self.options)
        self.daemon: Any = Daemon(self.clockwork, self.network, self.options, self.outside.publish)

    def run(self) -> "Life":
        """Run the life. Raises Broken, or another error of the code under test."""
        with self.daemon.disk:
            return self._run()

    def _run(self) -> "Life":
        self.daemon.start()
        for name in self.programs:
            self.clockwork.after(self.clockwork.between(0.0, 0.5), self._start, name)
        self._plan_faults()
        while self.clockwork.now < self.options.seconds and self.clockwork.step():
            pass
        self._heal()
        until = NEVER
        while self.clockwork.now < until:
            if not self._is_over():
                until = NEVER
            elif until == NEVER:
                until = self.clockwork.now + LAST_WORDS
            if (
                not self.clockwork.step()
                or self.clockwork.now > self.options.seconds + HEALED_WITHIN
            ):
                raise Broken(f"not over: {self._what_is_left()}")
        self._judge()
        return self

    # --- faults -----------------------------------------------------------------------------------

    def _plan_faults(self) -> None:
        options, clockwork = self.options, self.clockwork
        for rate, fault in (
            (options.breaks, self.network.break_one),
            (options.crashes, self._crash),
            (options.leaves, self._leave),
        ):
            at = 0.0
            while rate:
                at += clockwork.dice.expovariate(rate)
                if at > options.seconds:
                    break
                clockwork.after(at, fault)

    def _start(self, name: str) -> None:
        self.started[name] = self.started.get(name, 0) + 1
        self.processes[name] = Process(
            self.clockwork,
            self.network,
            self.outside,
            self.programs[name],
            self.started[name],
            lambda: self._end(name),
        )

    def _crash(self) -> None:
        alive = [name for name, process in self.processes.items() if process.is_alive]
        if alive and not self.is_healing:
            self.crashes += 1
            self._end(self.clockwork.dice.choice(alive))

    def _end(self, name: str) -> None:
        """Crash a process, and restart it later."""
        self.processes[name].crash()
        self.clockwork.after(self.clockwork.between(0.05, self.options.away), self._start, name)

    def _leave(self) -> None:
        serving = [
            name
            for name, one in self.processes.items()
            if one.is_alive and not one.is_leaving and one.has_finished and name in MODULES
        ]
        if serving and not self.is_healing:
            name = self.clockwork.dice.choice(serving)
            process = self.processes[name]
            process.leave()
            self._restart_after_leave(name, process)

    def _restart_after_leave(self, name: str, process: Process) -> None:
        """Restart a leaving module after its end."""
        if process.is_alive:
            self.clockwork.after(0.3, self._restart_after_leave, name, process)
        elif self.processes[name] is process:
            self._start(name)

    # --- the end ----------------------------------------------------------------------------------

    def _heal(self) -> None:
        self.clockwork.trace("life", "no faults from now on")
        self.is_healing = True
        self.options.central_crashes = self.options.full_disks = 0.0
        self.daemon.heal()
        self.options.crash_at = 0
        self.programs["janitor"] = Janitor(self.options, self.outside, self._suspended)
        self._start("janitor")

    def _is_gone(self, incarnation: str) -> bool:
        return all(
            one.incarnation != incarnation or not one.is_alive for one in self.processes.values()
        )

    def _suspended(self) -> list[TaskId]:
        assert self.daemon.core is not None
        return [TaskId(task) for task in self.daemon.core.tree.suspended]

    def _is_over(self) -> bool:
        core = self.daemon.core
        if (
            core is None
            or not self.network.is_listening
            or core.tree.tasks
            or core.dispatcher.running
        ):
            return False
        processes = self.processes.values()
        if len(self.processes) < len(self.programs) or not all(
            one.is_alive and one.has_finished and not one.is_leaving for one in processes
        ):
            return False
        return all(self._is_idle(process) for process in processes)

    def _is_idle(self, process: Process) -> bool:
        return all(
            not thread.stack and thread.session.is_welcome and not thread.session.prefetched
            for thread in process.threads
        )

    def _what_is_left(self) -> Any:
        core = self.daemon.core
        left = [str(task) for task in core.tree.tasks.values()] if core is not None else []
        waiting = [
            f"{thread.name}: {work.delivery}, waits for {work.request and work.request.header}"
            for process in self.processes.values()
            for thread in process.threads
            for work in thread.stack
        ]
        strangers = [
            thread.name
            for process in self.processes.values()
            for thread in process.threads
            if not thread.session.is_welcome
        ]
        gone = [
            name for name, one in self.processes.items() if not one.is_alive or not one.has_finished
        ]
        return left, waiting, strangers, gone

    def _judge(self) -> None:
        """Check the final state of the life."""
        core, outside = self.daemon.core, self.outside
        assert core is not None
        check_invariants(core)
        for token, task in outside.task_of.items():
            if task not in outside.known and not self.options.is_lossy:
                raise Broken(
                    f"token {token} was acknowledged as task {task}, which central does not know"
                )
            self._judge_task(token, task)
        self._judge_informs()
        if (wrong := checked([OPENED, *self.daemon.journal])) != []:
            raise Broken(f"tca check says of the journal: {wrong[0]}")
        for connection in core.registry.connections.values():
            # All living processes are back. Central may still await the connections of dead ones.
            if connection.outstanding and connection not in core.restart_pause.awaited:
                raise Broken(f"{connection.session} waits for {connection.outstanding}")

    def _judge_task(self, token: int, task: int) -> None:
        outside, core = self.outside, self.daemon.core
        assert core is not None
        if task not in outside.ended and task in outside.known:
            raise Broken(f"task {task} (token {token}) has no end")
        outcome = core.memory.outcome_of(task) if task in outside.known else None
        runs = outside.of_token[token]
        is_done = outcome is not None and outcome[0] is Outcome.DONE and not outcome[1]
        if is_done and not any(run.ended >= 0 and not run.failure for run in runs):
            raise Broken(
                f"task {task} (token {token}) is done, and no handler has done it: {[*map(str, runs)]}"
            )
        was_answered = token in outside.outcomes and not self.options.is_lossy
        if was_answered and outcome is not None and outside.outcomes[token][0] is not outcome[0]:
            raise Broken(
                f"task {task} (token {token}) is {outcome[0]}, and its sender was told {outside.outcomes[token]}"
            )

    def _judge_informs(self) -> None:
        """Check that every lost inform was counted."""
        outside = self.outside
        alive = {
            thread.session for process in self.processes.values() for thread in process.threads
        }
        heard = {token for tokens in outside.heard.values() for token in tokens}
        missing = sum(
            token not in heard
            for sender, tokens in outside.informs.items()
            if sender in alive
            for token in tokens
        )
        counted = (
            sum(sender.lost for sender in alive)
            + outside.dropped
            + outside.counts["lost by module"]
        )
        if missing > counted and not self.options.is_lossy:
            raise Broken(f"{missing} informs did not arrive, but {counted} were counted as lost")
        outside.counts["informs missing"] += missing
