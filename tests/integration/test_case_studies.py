"""The case studies of Lütkebohle et al., section 6.2: the messages of figures 13 to 15.

An observer of all tasks must see the transitions that the text describes.
"""

import runpy
from collections import defaultdict
from collections.abc import Callable
from contextlib import nullcontext
from itertools import takewhile
from pathlib import Path

import pytest

from tca_module import Change, Command, connect, testing
from tca_module.testing import LocalCentral

LAST = Command("last")
EXAMPLES = Path(__file__).parents[2] / "examples"
Step = tuple[str, int, str, str]
"""A message, the number of its task, the transition, and the module that made the transition."""


PlayExample = Callable[[str], list[Step]]


@pytest.fixture
def play_example(monkeypatch: pytest.MonkeyPatch) -> PlayExample:
    """Return a function that runs an example and returns its transitions in central's order."""

    def play(name: str) -> list[Step]:
        with LocalCentral() as central, connect("active memory", central) as memory:
            monkeypatch.setattr(testing, "LocalCentral", lambda: nullcontext(central))
            with memory.observe() as changes:
                runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
                memory.command(
                    LAST
                ).kill()  # by central's order, all earlier changes arrive before it
                seen = list(takewhile(lambda change: change.message != LAST.name, changes))
        return number_tasks(seen)

    return play


def number_tasks(changes: list[Change]) -> list[Step]:
    """Number the tasks of each message from 1."""
    known: dict[str, list[int]] = defaultdict(list)
    steps = []
    for change in changes:
        assert not change.missed
        if change.task.id not in known[change.message]:
            known[change.message].append(change.task.id)
        steps.append(
            (
                change.message,
                1 + known[change.message].index(change.task.id),
                change.transition,
                change.module,
            )
        )
    return steps


def transitions_of(story: list[Step], message: str, number: int = 1) -> list[str]:
    """Return the transitions of one task as texts: "transition by module"."""
    return [
        f"{name} by {module}".removesuffix(" by ")
        for one, nth, name, module in story
        if (one, nth) == (message, number)
    ]


def index_of(story: list[Step], message: str, number: int, transition: str) -> int:
    return next(
        place for place, one in enumerate(story) if one[:3] == (message, number, transition)
    )


def test_label_query_point_and_say_follow_figure_13(play_example: PlayExample) -> None:
    """Figure 13.

    The question is asked and accepted (1-5). The arm points while the voice asks (7-11). Another
    question is rejected (12-16). The arm goes back while the voice says thanks (18-21).
    """
    story = play_example("46_curious_robot_asks")
    assert transitions_of(story, "label query") == [
        "initiated by initiative",
        "accepted by dialog",
        "completed",
    ]
    assert transitions_of(story, "label query", 2) == ["initiated by initiative", "rejected"]
    for number in (1, 2):
        assert transitions_of(story, "point", number) == [
            "initiated by dialog",
            "accepted by arm",
            "completed",
        ]
        assert transitions_of(story, "say", number) == [
            "initiated by dialog",
            "accepted by voice",
            "completed",
        ]
    assert len(story) == 17
    starts, done = (
        [index_of(story, message, 1, transition) for message in ("point", "say")]
        for transition in ("initiated", "completed")
    )
    second_starts = [index_of(story, message, 2, "initiated") for message in ("point", "say")]
    assert index_of(story, "label query", 1, "accepted") < min(starts)
    assert max(starts) < min(done)  # side by side
    assert max(done) < min(second_starts)
    assert index_of(story, "label query", 2, "rejected") < min(second_starts)
    assert index_of(story, "label query", 1, "completed") == len(story) - 1


def test_grasp_feedback_and_updates_follow_figure_14(play_example: PlayExample) -> None:
    """Figure 14: feedback goes up from arm to coordinator to dialog. The update goes down, and its
    acceptance up.
    """
    story = play_example("47_curious_robot_grasps")
    changes = transitions_of(story, "grasp")
    feedback = [
        one for one in changes if one == "result available by coordinator"
    ]  # from another coroutine, so in any order with the rest
    assert len(feedback) == 2
    assert [one for one in changes if one not in feedback] == [
        "initiated by dialog",
        "accepted by coordinator",
        "update by dialog",
        "accept by coordinator",
        "update by dialog",
        "reject by coordinator",
        "completed",
    ]
    assert transitions_of(story, "reach") == [
        "initiated by coordinator",
        "accepted by arm",
        "result available by arm",
        "update by coordinator",
        "accept by arm",
        "result available by arm",
        "update by coordinator",
        "reject by arm",
        "completed",
    ]
    for transition in ("accept", "reject", "completed", "result available"):
        assert index_of(story, "reach", 1, transition) < index_of(story, "grasp", 1, transition)
    for transition in ("initiated", "update"):
        assert index_of(story, "grasp", 1, transition) < index_of(story, "reach", 1, transition)


def test_gaze_follows_figure_15_without_messages_of_its_own(play_example: PlayExample) -> None:
    """Figure 15: dialog accepts a question (1-3), and gaze observes that (4), but not a rejected
    question. The protocol has no messages for gaze.
    """
    story = play_example("48_curious_robot_looks")
    assert transitions_of(story, "label query", 1) == ["initiated by initiative", "rejected"]
    assert transitions_of(story, "label query", 2) == [
        "initiated by initiative",
        "accepted by dialog",
        "completed",
    ]
    assert transitions_of(story, "grasp") == [
        "initiated by initiative",
        "accepted by arm",
        "completed",
    ]
    assert {message for message, *_ in story} == {"label query", "grasp"}
