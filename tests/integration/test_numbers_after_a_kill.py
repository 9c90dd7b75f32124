"""Central is killed and begins anew, with real processes: tasks of the old one are not taken for those of the new one."""

import contextlib
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from integration.programs import central

from tca_module import CentralLost, Client, Command, Condition, Inform, SentTask, connect
from tca_tools.run.journals import open_log
from tca_wire.journal import facts, facts_of_watching

WORK, NOTE = Command("work", int), Inform("note")

CALLS: dict[str, Callable[[Client, SentTask[Any], SentTask[Any]], object]] = {
    "constrain": lambda user, old, new: user.constrain(old.achieving.end <= new.handling.start),
    "kill after": lambda _, old, new: new.kill(after=old.achieving.end),
    "deadline": lambda _, old, new: new.deadline(0.01, old.achieving.end),
    "tap": lambda user, old, _: user.tap(Condition.AFTER_ACHIEVED, old, NOTE),
    "under": lambda user, old, _: user.under(old).command(WORK, 1),
    "kill": lambda _user, old, _new: old.kill(),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("has_heard", [True, False], ids=["known", "unheard"])
def test_a_killed_central_takes_its_numbers_with_it(tmp_path: Path, call: str, *, has_heard: bool) -> None:
    again = tmp_path / "again"
    again.mkdir()
    with central(tmp_path) as first, connect("user", first.address) as user:
        old = user.command(WORK, 1)
        first.signal(signal.SIGKILL)
        first.process.wait()
        with central(again, bind=first.address) as second, connect("stranger", first.address) as stranger:
            theirs = stranger.command(WORK, 2)
            if has_heard:
                with contextlib.suppress(CentralLost):
                    user.modules()
            new = (user if has_heard else stranger).command(WORK, 3, sequential=False)
            assert theirs.id == old.id
            with pytest.raises(CentralLost, match="is lost: central was restarted"):
                CALLS[call](user, old, new)
            assert [task.data(WORK) for task in stranger.tasks(WORK)] == [2, 3]
        told = [fact for entry in open_log(second.journal) for fact in entry.facts]
        done = facts.Constrained | facts.KillPlanned | facts.Killed | facts.DeadlineSet | facts_of_watching.TapAdded
        assert not [fact for fact in told if isinstance(fact, done)]
