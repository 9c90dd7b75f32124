"""Central is killed and begins anew, with real processes: tasks of the old one are not taken for those of the new one."""

import contextlib
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from integration.programs import central

from tca_module import CentralLost, Client, Command, Condition, Inform, SentTask, connect
from tca_tools.run.journals import open_log
from tca_wire.journal import facts

WORK, NOTE = Command("work", int), Inform("note")

CALLS: dict[str, Callable[[Client, SentTask[Any], SentTask[Any]], object]] = {
    "constrain": lambda user, old, new: user.constrain(old.achieving.end <= new.handling.start),
    "kill after": lambda _, old, new: new.kill(after=old.achieving.end),
    "deadline": lambda _, old, new: new.deadline(0.01, old.achieving.end),
    "tap": lambda user, old, _: user.tap(Condition.AFTER_ACHIEVED, old, NOTE),
    "under": lambda user, old, _: user.under(old).command(WORK, 1),
    "kill": lambda _user, old, _new: old.kill(),
}


@pytest.mark.parametrize("has_heard", [True, False], ids=["known", "unheard"])
def test_a_killed_central_takes_its_numbers_with_it(tmp_path: Path, *, has_heard: bool) -> None:
    """Each call is the first one of its user."""
    with ExitStack() as stack:
        first = stack.enter_context(central(tmp_path))
        users = {call: stack.enter_context(connect(call, first.address)) for call in CALLS}
        olds = {call: user.command(WORK, 1) for call, user in users.items()}
        first.signal(signal.SIGKILL)
        first.process.wait()
        second = stack.enter_context(central(tmp_path / "again", bind=first.address))
        stranger = stack.enter_context(connect("stranger", first.address))
        theirs = [stranger.command(WORK, 2) for _ in CALLS]
        assert [task.id for task in theirs] == [old.id for old in olds.values()]
        for call, user in users.items():
            if has_heard:
                with contextlib.suppress(CentralLost):
                    user.modules()
            new = (user if has_heard else stranger).command(WORK, 3, sequential=False)
            with pytest.raises(CentralLost, match="is lost: central was restarted"):
                CALLS[call](user, olds[call], new)
        assert sorted(task.data(WORK) for task in stranger.tasks(WORK)) == [2] * len(CALLS) + [3] * len(CALLS)
    told = [fact for entry in open_log(second.journal) for fact in entry.facts]
    done = facts.Constrained | facts.KillPlanned | facts.Killed | facts.DeadlineSet | facts.TapAdded
    assert not [fact for fact in told if isinstance(fact, done)]
