"""The facts that are known to hold, as activities change them."""

from collections.abc import Mapping

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.situation import Fact


class KnownFacts:
    """Facts that hold. A fact is unknown while an activity that makes it runs."""

    def __init__(self, facts: Mapping[str, Fact]) -> None:
        self.known = dict(facts)

    def begin(self, activity: Activity) -> dict[str, Fact]:
        """Mark the facts of a starting activity as unknown. Returns their values until now."""
        before = {name: self.known[name] for name in activity.makes if name in self.known}
        for name in before:
            del self.known[name]
        return before

    def finish(self, activity: Activity) -> None:
        """Set the facts of an activity that is done."""
        self.known |= activity.makes

    def unmet(self, activity: Activity) -> str:
        """Describe the needs of an activity that do not hold; "" if all do."""
        return ", ".join(
            f"'{name}' must be {value!r} and is {self._text(name)}"
            for name, value in activity.needs.items()
            if self.known.get(name) != value
        )

    def _text(self, name: str) -> str:
        return repr(self.known[name]) if name in self.known else "unknown"
