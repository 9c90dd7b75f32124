"""Advice says whose end would come sooner: of the path that is shown first, or of the task that took longest."""

import pytest
from tools.story import Story

from tca_tools.report.contents import Contents, contents
from tca_wire.journal import facts
from tca_wire.points import Moment


@pytest.fixture(scope="module")
def found() -> Contents:
    """*pour* waits six seconds for a lock, and takes two; long after it comes a *clean*, which waits half a second until
    somebody handles it.
    """
    story = Story().module("op").module("tank", "pour")
    story.at(1.0).say(facts.Claimed(50, "tank", "tank", False, "op", 0), facts.Granted(50)).at(2.0)
    pour = story.command("pour", "user")
    story.queued(pour, "tank").at(8.0).say(facts.ClaimEnded(50, "released")).delivered(pour, "tank")
    story.at(10.0).returned(pour).reached(pour, Moment.END_ACHIEVING).at(20.0)
    clean = story.command("clean", "user")
    story.queued(clean).at(20.5).module("maid", "clean").delivered(clean, "maid")
    return contents(story.at(21.5).returned(clean).reached(clean, Moment.END_ACHIEVING).fold())


def test_first_comes_what_moves_the_end(found: Contents) -> None:
    assert found.path
    assert found.longest
    assert (str(found.path.path.task), str(found.longest.path.task)) == ("clean {2}", "pour {1}")
    first, second = found.advice
    assert (first.title, first.sooner) == ("Nobody handles 'clean' for a while", "")
    assert (round(first.saving, 6), round(first.on_path, 6)) == (0.5, 0.5)
    assert (second.title, second.sooner) == ("tank is locked while others wait", "pour {1}")
    assert (round(second.saving, 6), second.on_path) == (6.0, 0.0)
