"""In random lives of handlers that block: people are told what the graph of needs has, all of it."""

from hypothesis import given, settings
from properties.test_deadlocks import Blocking, steps

from tca_central.needs.graph import needs
from tca_central.needs.waits import NAMED, Ends, next_of, waits_of
from tca_central.order.cycles import Place
from tca_wire.text.waits_in_words import several_in_words


class Told(Blocking):
    def compare(self) -> None:
        ends = Ends(self.central, 100_000)
        for task in self.central.tree.tasks.values():
            place = next_of(task)
            told = waits_of(self.central, place)
            assert not told or several_in_words(told)
            assert ends.end_of(place) is not None
            if task.slot is None and task.queues is None:
                self.compare_with_graph(place, {wait.number for wait in told}, sum(wait.more for wait in told))
                assert told or not self.awaited(place)

    def compare_with_graph(self, place: Place, told: set[int], more: int) -> None:
        awaited = self.awaited(place)
        suspended = set(self.central.tree.suspended)
        assert told - {0} <= awaited | suspended
        assert awaited <= told or (more and len(told) >= NAMED), f"{place}: {awaited} and not {told}"

    def awaited(self, place: Place) -> set[int]:
        """The other tasks that the graph names, from point to point of the task itself."""
        places, found = [place], set[int]()
        for own in places:  # grows while it is walked
            for one in (one for group in needs(self.central, own) for one in group or ()):
                if isinstance(one, Place) and one.task is not place.task:
                    found.add(one.task.id)
                elif isinstance(one, Place) and one not in places:
                    places.append(one)
        return found


@given(steps)
@settings(max_examples=100)
def test_what_is_told_is_what_the_graph_has(taken: list[tuple[str, int, int, int]]) -> None:
    life = Told(looks=True)
    life.hello("operator")
    for step in taken:
        life.do(*step)
        life.compare()
