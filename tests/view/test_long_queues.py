"""What waits by the thousand: its bars lie in lanes as in the other charts, and the page does not stand still for them."""

import math
from pathlib import Path
from types import TracebackType

import pytest
from tools.story import Story

from tca_tools.run.at_time import RunAt
from tca_tools.run.journals import Log, Place, open_log
from tca_tools.view import answers
from tca_tools.view.answers import causes_answer
from tca_tools.view.reading import Reading
from tca_tools.why.last import causes
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import TaskId

pytestmark = pytest.mark.slow


def queue_of(number: int) -> Story:
    """A command that is handled, and others that wait for the same resource from one second after the other."""
    story = Story().module("legs", "move").at(1.0)
    story.delivered(story.command("move", "user"), "legs")
    for second in range(2, number + 2):
        story.at(second).queued(story.command("move", "user"), "legs")
    return story


PLACE = Place(Path("none"), 0)


class Watched(Reading):
    """Others look at it, or more is read, whenever that is possible."""

    def __init__(self, log: Log, entries: list[Entry], patch: pytest.MonkeyPatch) -> None:
        patch.setattr(answers, "_WHILE", 0.002)
        super().__init__(log)
        self.looks = 0
        self.entries_to_come = entries

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self.looks += 1
        if self.looks == 2 and self.entries_to_come:
            self._pending = [(entry, PLACE) for entry in self.entries_to_come]
            self._take()


@pytest.mark.parametrize("moment", [3000.0, 3900.0, math.inf])
@pytest.mark.parametrize("read_before", [3500, 4003])
def test_others_are_let_in_while_causes_are_looked_for(
    tmp_path: Path, moment: float, read_before: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What comes meanwhile is of later moments: the answer is of when it was asked for."""
    story = queue_of(4000)
    reading = Watched(open_log(story.write(tmp_path / "long")), story.entries[read_before:], monkeypatch)
    for entry in story.entries[:read_before]:
        reading.feed.apply(entry)
    asked = min(moment, reading.feed.history.time)
    answer = causes_answer(reading, moment)
    waiting, things, found = causes(RunAt(story.fold(), asked))
    assert answer == {"waiting": waiting, "things": things, "causes": [one._asdict() for one in found]}
    assert reading.looks >= 3


@pytest.mark.parametrize("later", [0, 5])
def test_more_of_the_entry_that_is_looked_at_counts(
    tmp_path: Path, later: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An event of very many facts has several records; between two of them a page may have asked."""
    story = queue_of(2000)
    last = story.entries[-1]
    more: list[facts.Fact] = [facts.SuspendedOrResumed(TaskId(5), is_suspended=True)]
    to_come = [Entry(last.number, last.time, more), *queue_of(2000 + later).entries[len(story.entries) :]]
    reading = Watched(open_log(story.write(tmp_path / "long")), to_come, monkeypatch)
    for entry in story.entries:
        reading.feed.apply(entry)
    answer = causes_answer(reading, last.time)
    last.facts.extend(more)
    waiting, things, found = causes(RunAt(story.fold(), last.time))
    assert answer == {"waiting": waiting, "things": things, "causes": [one._asdict() for one in found]}
    assert things == 2
