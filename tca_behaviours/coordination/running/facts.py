"""What is known to hold, as activities change it."""

from collections.abc import Mapping

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.situation import Fact


class KnownFacts:
    """Facts that hold. What an activity makes is unknown from its start until it is done."""

    def __init__(self, facts: Mapping[str, Fact]) -> None:
        self.known = dict(facts)

    def begin(self, activity: Activity) -> dict[str, Fact]:
        """An activity starts; what it is going to change, as it was until now."""
        before = {name: self.known[name] for name in activity.makes if name in self.known}
        for name in before:
            del self.known[name]
        return before

    def finish(self, activity: Activity) -> None:
        """It is done."""
        self.known |= activity.makes

    def unmet(self, activity: Activity) -> str:
        """What it needs and what does not hold, in words; "" if all does."""
        found = [
            f"'{name}' must be {value!r} and is {repr(self.known[name]) if name in self.known else 'unknown'}"
            for name, value in activity.needs.items()
            if self.known.get(name) != value
        ]
        return ", ".join(found)
