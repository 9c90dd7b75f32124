"""Test without a daemon: a LocalCentral runs central's core in the test's own process.

With ``stepped=True`` the test also advances the clock.
"""

from tca_module import Command, Goal, Module, Outcome, Task, connect
from tca_module.testing import LocalCentral

FETCH, GRASP = Goal("fetch", str), Command("grasp", str)

HAPPENED = """\
   0.000  received: goal fetch {1} from test: "cup"
   0.000  delivered: fetch {1} to planner
   0.000  reached: fetch {1}: start handling, start planning
   0.000  reached: fetch {1}: start achieving
   0.000  received: command grasp {2} from planner under fetch {1}: "cup"
   0.000  reached: grasp {2}: start planning, end planning
   0.000  deadline: grasp {2}: end achieving within 60 s
   0.000  queued: grasp {2} for a handler
   0.000  returned: fetch {1}: done
   0.000  reached: fetch {1}: end handling, end planning
"""


def make_planner(central: LocalCentral) -> Module:
    planner = Module("planner", central)

    @planner.handles(FETCH)
    def fetch(task: Task, thing: str) -> None:
        task.command(GRASP, thing, deadline=60)

    return planner


def test_fetching_is_grasping() -> None:
    with LocalCentral() as central:
        grasp = central.fake(GRASP)
        planner = make_planner(central)
        central.start(planner)
        assert planner.goal(FETCH, "cup").wait(timeout=5) is Outcome.DONE
        assert grasp.calls == ["cup"]


def test_without_a_hand_a_fetch_fails_after_a_minute() -> None:
    with (
        LocalCentral(stepped=True) as central,
        make_planner(central).running(),
        connect("test", central) as user,
    ):
        fetch = user.goal(FETCH, "cup")
        central.until_quiet()
        assert central.transcript() == HAPPENED
        central.advance(59)
        assert central.transcript() == HAPPENED
        central.advance(1)
        assert fetch.wait(timeout=5) is Outcome.FAILED
        assert "  60.000  failed: grasp {2}: timeout" in central.transcript()


if __name__ == "__main__":
    test_fetching_is_grasping()
    test_without_a_hand_a_fetch_fails_after_a_minute()
    print("passed")
