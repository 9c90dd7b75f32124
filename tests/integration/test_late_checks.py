"""A check comes while a move waits already, with real processes: the move is checked, also where central was restarted."""

import contextlib
import signal
from contextlib import ExitStack
from pathlib import Path

from integration.programs import Central, central, program
from tools.runs import checked

from tca_module import CentralLost, Command, Outcome, connect
from tca_tools.run.journals import open_log
from tca_wire.journal import facts

MOVE = Command("move", int)
CHECK = Command("check", int)
SOON = 30.0

LEGS = """
    from tca_module import *
    module = Module("legs")
    @module.handles(Command("move", int))
    def move(task: Task, number: int) -> None:
        print("move", number, flush=True)
    with module.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""
SAFETY = """
    from tca_module import *
    MOVE, CHECK = Command("move", int), Command("check", int)
    module = Module("safety")
    @module.handles(CHECK)
    def check(task: Task, number: int) -> None:
        print("check", number, flush=True)
    module.at_start(lambda module: module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK))
    with module.running():
        import signal; signal.pause()
"""


def test_moves_that_wait_when_the_module_with_the_check_comes_are_checked(tmp_path: Path) -> None:
    with ExitStack() as stack:
        first = stack.enter_context(central(tmp_path))
        legs = stack.enter_context(program(LEGS, first.address))
        user = stack.enter_context(connect("user", first.address))
        user.wait_until_handled(MOVE, timeout=SOON)
        with user.lock("legs"):
            moves = [user.command(MOVE, number, sequential=False) for number in (1, 2)]
            safety = stack.enter_context(program(SAFETY, first.address))
            user.wait_until_handled(CHECK, timeout=SOON)
        assert [move.wait(SOON) for move in moves] == [Outcome.DONE] * 2
        assert safety.stdout
        assert [safety.stdout.readline() for _ in moves] == ["check 1\n", "check 2\n"]
        assert delivered_after_checks(first) == [1, 2]

        safety.send_signal(signal.SIGSTOP)
        first.signal(signal.SIGKILL)
        first.process.wait()
        again = tmp_path / "again"
        again.mkdir()
        second = stack.enter_context(central(again, bind=first.address))
        with contextlib.suppress(CentralLost):
            user.modules()
        user.wait_until_handled(MOVE, timeout=SOON)
        with user.lock("legs"):
            move = user.command(MOVE, 3)
            safety.send_signal(signal.SIGCONT)
            user.wait_until_handled(CHECK, timeout=SOON)
        assert move.wait(SOON) is Outcome.DONE
        assert safety.stdout.readline() == "check 3\n"
        assert delivered_after_checks(second) == [3]
        assert legs.poll() is None


def delivered_after_checks(central: Central) -> list[int]:
    """The numbers of the moves that were given to the legs; each after its check, as the journal says."""
    entries = list(open_log(central.journal))
    assert checked(entries) == []
    told = [fact for entry in entries for fact in entry.facts]
    births = {fact.id: fact for fact in told if isinstance(fact, facts.Received)}
    given = [births[fact.message_id] for fact in told if isinstance(fact, facts.Delivered)]
    moves = [birth for birth in given if birth.message == MOVE.name]
    for move in moves:
        (check,) = (birth.id for birth in given if birth.message == CHECK.name and birth.about == move.id)
        returned = next(at for at, fact in enumerate(told) if isinstance(fact, facts.Returned) and fact.id == check)
        assert returned < next(
            at for at, fact in enumerate(told) if isinstance(fact, facts.Delivered) and fact.id == move.id
        )
    return [move.body[0] for move in moves]
