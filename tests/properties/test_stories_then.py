"""A story at a moment says what was known then, and nothing of what came later: after every event of a random life."""

from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation

from tca_central.events import Effect, Record
from tca_tools.run.fold import History
from tca_tools.run.whole_run import Run
from tca_tools.why.story import story

Told = dict[int, list[str]]
_NO_TIME = 1e-6
"""Seconds: states that last no longer are not told of."""


def told(run: Run, moment: float) -> Told:
    """The stories of all messages as they were then."""
    return {
        number: [f"{one.time:.6f} {one.by(moment, moment)}" for one in story(run, number, moment) if one.time <= moment]
        for number, message in run.messages.items()
        if message.received <= moment
    }


class TellingPlayer(Player):
    """Folds every entry, and notes what is told after every third one."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.history = History()
        self.told: list[tuple[float, Told]] = []

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        for effect in effects:
            if isinstance(effect, Record):
                self.history.apply(effect.entry)
                if len(self.history.times) % 3 == 0:
                    self.told.append((self.history.time, told(self.history, self.history.time)))
        return effects

    def compare(self) -> None:
        times = self.history.times
        for moment, before in self.told:
            place = times.index(moment) + 1
            if place < len(times) and times[place] - moment > _NO_TIME:
                now = told(self.history, moment)
                for number, sentences in before.items():
                    assert now[number] == sentences, f"message {number} at {moment}"


@given(st.lists(operation, max_size=50))
@settings(max_examples=60)
def test_stories_of_the_past_are_as_they_were(operations: list[tuple[str, int, int, int, int]]) -> None:
    player = TellingPlayer()
    life = Life(player)
    for name, *numbers in operations:
        life.do(name, *numbers)
    player.compare()


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_stories_of_a_longer_past_are_as_they_were(seed: int) -> None:
    player = TellingPlayer()
    Life(player).go_on(seed, 200)
    player.compare()
