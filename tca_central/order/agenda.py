"""The agenda: which moment of which task may be reached when. It knows no resources or sockets.

Theory of operation. A task is checked again when its constraints are met (holds.py counts them),
and when its parent or a child has advanced. A child starts planning or achieving only after its
parent has. A parent ends planning or achieving only after all its children have. ``advance_all``
runs until nothing advances. Each point is reached once and each constraint released once. The cost
of an event therefore depends on the number of changes, not on the size of the tree. No function
calls itself, because a tree may be thousands of tasks deep.
"""

from collections import deque

from tca_central.errors import RequestError
from tca_central.model.clock import Clock
from tca_central.model.deliveries import Delivery, Wiretap
from tca_central.model.intervals import delivered_at
from tca_central.model.stored import Stored
from tca_central.model.task_tree import (
    TaskTree,
    first_moments,
    sending_module,
    taps_of,
    to_be_fired,
)
from tca_central.model.tasks import Recovery, Tapping, Task, Verdict
from tca_central.order.holds import SEQ_ACH, Holds, PendingDelay, from_flags, is_held, resolve
from tca_wire.constraints import Constraint, Flags
from tca_wire.journal.facts import Fact, Killed, Reached, TimedOut
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    STARTS,
)
from tca_wire.rules import KILLED, RULES
from tca_wire.text.facts_in_words import kill_reason
from tca_wire.vocabulary import Role


class Agenda(Stored):
    """The decision which moments are reached, and the queues of results that the core empties."""

    __slots__ = (
        "_clock",
        "_facts",
        "ended",
        "ended_waits",
        "holds",
        "only_background_left",
        "resumed_monitors",
        "startable",
        "tap_events",
        "taps_to_fire",
        "to_advance",
        "tree",
        "wait_count",
        "with_undecided_requests",
        "withdrawn",
    )

    def __init__(self, tree: TaskTree, facts: list[Fact], clock: Clock) -> None:
        self.tree = tree
        self.holds = Holds(tree, facts, clock)
        self._facts, self._clock = facts, clock
        self.to_advance: deque[Task] = deque()  #: tasks that may have become able to advance
        self.startable: deque[Task] = deque()  #: tasks that may be given to a handler
        #: Tasks whose handlers returned without answering clients' requests.
        self.with_undecided_requests: deque[Task] = deque()
        self.withdrawn: deque[tuple[Task, bool]] = deque()
        """Tasks that may not start now, so they must leave their queues.

        Each comes with True if a suspension is the only reason.
        """
        self.ended: deque[Task] = deque()  #: tasks that have reached their last moment
        self.wait_count = 0  #: number of entries in all ``Task.waiters``
        #: Waits whose moment has been reached.
        self.ended_waits: deque[tuple[Task, Stored]] = deque()
        #: Wiretaps to fire before a task may advance.
        self.taps_to_fire: deque[tuple[Task, list[Wiretap]]] = deque()
        #: Events of messages at which wiretaps may fire.
        self.tap_events: deque[tuple[Delivery, int]] = deque()
        self.resumed_monitors: deque[Task] = deque()  #: monitors that are no longer suspended
        #: Tasks whose only open children are background monitors.
        self.only_background_left: deque[Task] = deque()

    # --- calls of the core ------------------------------------------------------------------------

    def add(
        self, task: Task, parent: Task, flags: Flags, wanted: list[Constraint]
    ) -> list[Constraint]:
        """Add a new task under *parent*. Return the new constraints, with the task's id for THIS.

        Raises RequestError if a constraint can never be met. The tree is then as before.
        """
        sender = sending_module(task)
        last = self.tree.last_sibling(parent, sender)
        self.tree.attach(task, parent)
        task.reached |= RULES[task.message.is_goal].at_birth
        if task.is_goal:
            parent.unplanned += 1
        added: list[Constraint] = []
        if wanted or last is not None or flags != SEQ_ACH:
            added = self._constrain_new(task, last, flags, wanted)
        self.tree.become_last(task, parent, sender)
        task.suspended = parent.suspended and not task.role.runs_while_suspended
        # A new child of a killed parent is killed, too. So is a new child of a parent that is to be
        # retried: the handling that sent the child no longer counts.
        is_late = parent.retry_pending and not (task.role or task.is_foreign_monitor)
        if (parent.killed or is_late) and not task.role.survives:
            self.kill(task, Verdict(parent.killed or f"{parent} is retried"))
            self.tap_events.append((task, KILLED))
        self.to_advance.append(task)
        if parent.returned and task.is_background:  # the parent may have no other child
            self.to_advance.append(parent)
        return added

    def _constrain_new(
        self, task: Task, last: Task | None, flags: Flags, wanted: list[Constraint]
    ) -> list[Constraint]:
        """Add the constraints that came with a new task.

        On RequestError the task is removed from the tree.
        """
        follows = self.holds.follow(task, last, int(flags)) if last is not None else []
        own = [
            *from_flags(int(flags), task),
            *(resolve(constraint, task.id) for constraint in wanted),
        ]
        try:
            return self._add_all(own, follows, task)
        except RequestError:
            self.tree.detach(task)
            if task.parent is not None:
                task.parent.unplanned -= task.is_goal
            raise

    def constrain(self, wanted: list[Constraint]) -> list[Constraint]:
        """Add constraints between existing tasks: all of them or, with RequestError, none.

        Returns those that hold something.
        """
        return self._add_all(wanted, [])

    def _add_all(
        self, wanted: list[Constraint], added: list[Constraint], new: Task | None = None
    ) -> list[Constraint]:
        """Put the *wanted* constraints in force: all of them or, with RequestError, none.

        The constraints in *added* are in force already. With RequestError they are undone, too.
        Queued tasks that a constraint now holds leave their queues. A *new* task is in no queue
        yet. Returns all constraints that hold something.
        """
        try:
            for constraint in wanted:
                added += self.holds.add(constraint)
        except RequestError:
            self.holds.undo(added)
            raise
        for constraint in added:
            if new is None or constraint.after.task != new.id:
                self._withdraw_if_held(self.tree.tasks[constraint.after.task])
        return added

    def mark_started(self, task: Task) -> None:
        """Reach the first moments of a task that was given to a handler."""
        if task.recovery is not None and task.recovery.policy is not None:
            task.recovery.policy.begin_attempt(self._clock)
        if not task.reached & START_HANDLING:
            self._reach(task, first_moments(task) & ~task.reached)
            # A goal's achieving may start now. A monitor that was ended by a request before its
            # start counts as returned: it may end now.
            if task.is_goal or task.returned:
                self.to_advance.append(task)
        self._recheck_parent(task)

    def _recheck_parent(self, task: Task) -> None:
        """Advance a background monitor's parent, which may have only background monitors left."""
        if task.is_background and task.parent is not None:
            self.to_advance.append(task.parent)

    def mark_returned(self, task: Task) -> None:
        """Record that the task's handler has returned for good."""
        if task.clients is not None and task.clients.asked:
            self.with_undecided_requests.append(task)
        task.returned = True
        self.to_advance.append(task)

    def retry(self, task: Task) -> None:
        """Have a started task handled again as soon as ``Task.may_be_handled_again`` is true."""
        task.retry_pending, task.returned = True, False
        if task.tapping is not None:
            to_come = START_HANDLING | (ALL_MOMENTS & ~task.reached)
            task.tapping.fire_again(tap.id for tap in taps_of(task) if tap.held_moment & to_come)
        self.recheck_restart(task)
        self._recheck_parent(task)

    def end_or_retry(self, task: Task) -> bool:
        """End a killed task, or retry a task whose retry is pending. Its handler has returned.

        Returns False for any other task. For such a task the handler's outcome counts.
        """
        if task.killed:
            self.mark_returned(task)
        elif task.retry_pending:
            self.retry(task)
        return bool(task.killed) or task.retry_pending

    def end_retry_request(self, task: Task, exception_handler: Task) -> None:
        """Check whether a retry may start: an exception handler that asked for it has ended."""
        Recovery.of(task).retry_requesters.pop(exception_handler, None)
        self.to_advance.append(task)

    def mark_decision_processed(self, task: Task) -> None:
        """Record that the decision of one of the task's ended exception handlers was processed."""
        Recovery.of(task).unprocessed_decisions -= 1
        self.to_advance.append(task)

    def fire_taps_again(self, task: Task) -> None:
        """Have the wiretaps that fire before moments of an unstarted task fire once more."""
        again = {tap.id for tap in taps_of(task) if tap.held_moment & ~task.reached}
        if again:
            Tapping.of(task).fire_again(again)
            if task.queues is not None:
                self._withdraw(task)
            self.to_advance.append(task)

    def recheck_restart(self, task: Task) -> None:
        """Remove a started task from its queues, and check whether it may be handled again."""
        if task.queues is not None:
            self.withdrawn.append((task, False))
        self.recheck_start(task)

    def recheck_start(self, task: Task) -> None:
        """Check whether a task that is in no queue may start."""
        task.start_granted = False
        self.to_advance.append(task)

    def end_delay(self, delay: PendingDelay) -> None:
        """Release the moment that a delay has held: the delay is over."""
        self.holds.end_delay(delay)
        if not delay.task.killed:
            self._facts.append(TimedOut(delay.constraint))
        self.to_advance.append(delay.task)

    def kill(self, task: Task, verdict: Verdict) -> list[Task]:
        """Mark a task, and every descendant that is killed with it, as killed.

        Returns the tasks that were not killed before, parents first.
        """
        killed = [doomed for doomed in self.tree.subtree(task, doomed=True) if not doomed.killed]
        reason = kill_reason(verdict.why, verdict.by)
        for doomed in killed:
            doomed.killed = reason
            if unbegun := STARTS & ~doomed.reached:
                self.tree.never_began[doomed.id] = unbegun
            self._facts.append(Killed(doomed.id, *verdict))
        self.holds.pass_on(killed)
        for doomed in killed:
            if not doomed.is_running:
                doomed.returned = True
                self.withdrawn.append((doomed, False))
            self.to_advance.append(doomed)
        return killed

    def suspend(self, task: Task, *, resume: bool) -> list[Task]:
        """Suspend or resume a subtree. Return the tasks that this has changed.

        Nothing in a suspended subtree is started. Running handlers continue.
        """
        changed = []
        for node in self.tree.subtree(task):
            if node.suspended is not resume:
                continue
            node.suspended = not resume
            changed.append(node)
            self._recheck_parent(node)
            if resume:
                self.to_advance.append(node)
                if node.message.message_class.is_monitor:
                    self.resumed_monitors.append(node)
            elif node.start_granted and node.queues is not None:
                self._withdraw(node, is_suspended=True)
        return changed

    def add_waiter(self, task: Task, moment: int, waiter: Stored) -> None:
        """Have *waiter* put into ``ended_waits`` when the task reaches *moment*."""
        if task.waiters is None:
            task.waiters = {}
        if waiter not in task.waiters:
            self.wait_count += 1
        task.waiters[waiter] = moment

    def stop_waiting(self, task: Task, waiter: Stored) -> None:
        """Forget a wait that is no longer needed."""
        if task.waiters is not None and task.waiters.pop(waiter, None) is not None:
            self.wait_count -= 1

    def advance_all(self) -> None:
        """Advance tasks until none can reach another moment."""
        while self.to_advance:
            self._advance(self.to_advance.popleft())
        if self.holds.ending:
            self.holds.ending.clear()

    # --- reaching moments -------------------------------------------------------------------------

    def _advance(self, task: Task) -> None:
        """Reach all moments that a task may reach now. Make the task startable if it may start."""
        if task.reached == ALL_MOMENTS:
            return
        if task.killed or task.reached & START_HANDLING:
            self._reach_due_moments(task)
        if not (task.start_granted or task.killed) and self._may_start(task):
            task.start_granted = not (task.message.taps or task.tapping) or self._pass_or_fire_taps(
                task, first_moments(task)
            )
            if task.start_granted:
                self.startable.append(task)
        if task.background_monitors and task.has_only_background_left:
            self.only_background_left.append(task)

    def _reach_due_moments(self, task: Task) -> None:
        """Reach every moment of a started or killed task whose conditions are met.

        ``TaskRules.order`` is sorted, so one pass is enough.
        """
        before = reached = task.reached
        if task.killed and task.slot is None:
            reached |= STARTS
        is_tapped = task.message.taps or task.tapping is not None
        for moment, needed in RULES[task.message.is_goal].order:
            if (
                not reached & moment
                and reached & needed == needed
                and self._may_reach(task, moment)
            ):
                if is_tapped and not self._pass_or_fire_taps(task, moment):
                    break
                reached |= moment
        if reached != before:
            self._reach(task, reached & ~before)

    def _pass_or_fire_taps(self, task: Task, moments: int) -> bool:
        """Return whether no wiretap keeps a task from reaching *moments*.

        If wiretaps must fire before *moments*, queue these wiretaps in ``taps_to_fire``.
        """
        tapping = task.tapping
        if task.killed or not (task.message.taps or (tapping is not None and tapping.taps)):
            return True
        if tapping is not None and tapping.is_firing:
            return False
        new = to_be_fired(task, moments)
        if new:
            Tapping.of(task).is_firing = True
            self.taps_to_fire.append((task, new))
        return not new

    def taps_fired(self, task: Task) -> None:
        """Check a task again after its wiretaps have fired: their listeners may hold it now."""
        Tapping.of(task).is_firing = False
        self.to_advance.append(task)
        self._recheck_parent(task)

    def _may_start(self, task: Task) -> bool:
        """Whether all conditions for the delivery of a task are met."""
        if task.suspended or (task.retry_pending and not task.may_be_handled_again):
            return False
        # Before the first delivery, START_HANDLING is held through ``delivered_at``. A retried
        # task has passed that moment: its listeners hold START_HANDLING itself.
        if task.held and is_held(task, START_HANDLING):
            return False
        if task.planning_delayed and not self._may_reach(task, START_ACHIEVING):
            return False
        return self._may_reach(task, delivered_at(task.is_goal))

    def _may_reach(self, task: Task, moment: int) -> bool:
        """Whether a moment may be reached, as far as constraints and relatives are concerned."""
        if task.held and not task.killed and is_held(task, moment):
            return False
        if moment & STARTS:
            if task.killed:
                return task.slot is None
            # A task that central made (it has a role) need not wait for its parent.
            return bool(task.role) or bool(task.parent and task.parent.reached & moment)
        if moment == END_HANDLING or not task.returned:
            return task.returned
        if task.recovery is not None and task.recovery.unprocessed_decisions and not task.killed:
            return False  # the task may fail again, and wait for another exception handler
        open_children = task.children if moment == END_ACHIEVING else task.unplanned
        return not open_children

    def _reach(self, task: Task, moments: int) -> None:
        """Record *moments* of a task as reached. Queue the tasks that may advance as a result."""
        task.reached |= moments
        self._facts.append(Reached(task.id, moments))
        # Each condition below saves a call. Most tasks have no wiretap, waiter or follower, and
        # this function runs for every moment of every task.
        if not task.killed and (
            task.message.taps or (task.tapping is not None and task.tapping.taps)
        ):
            self.tap_events.append((task, moments))
        if task.waiters:
            for waiter in [waiter for waiter, moment in task.waiters.items() if moment & moments]:
                self.ended_waits.append((task, waiter))
                del task.waiters[waiter]
                self.wait_count -= 1
        if task.followers:
            self.to_advance.extend(self.holds.release_followers(task, moments))
        if task.children and moments & (START_PLANNING | START_ACHIEVING):
            self.to_advance.extend(task.children.values())
        if moments & END_PLANNING and task.is_goal and (parent := task.parent) is not None:
            parent.unplanned -= 1
            if not parent.unplanned:
                self.to_advance.append(parent)
        if task.reached == ALL_MOMENTS:
            self._remove_ended(task)

    def _remove_ended(self, task: Task) -> None:
        """Remove a task that has reached its last moment from the tree."""
        self.tree.detach(task)
        if task.held:
            self.holds.forget(task)
        self.ended.append(task)
        parent = task.parent
        if task.role is Role.EXCEPTION and parent is not None:
            Recovery.of(parent).unprocessed_decisions += 1
        if parent is None or not (parent.returned or parent.retry_pending):
            return
        if parent.retry_pending or len(parent.children or ()) == len(
            parent.background_monitors or ()
        ):
            self.to_advance.append(parent)

    def _withdraw_if_held(self, task: Task) -> None:
        """Remove an undelivered task from its queues if a new constraint holds it."""
        self._recheck_parent(task)
        if task.start_granted and not task.reached & START_HANDLING and not self._may_start(task):
            self._withdraw(task)

    def _withdraw(self, task: Task, *, is_suspended: bool = False) -> None:
        """Have the core remove a task from its queues (``withdrawn``)."""
        task.start_granted = False
        self.withdrawn.append((task, is_suspended))
