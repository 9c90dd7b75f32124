"""The predicate that central took what a script asked for: of explorations only, a journal does not tell."""

from typing import Any

from tca_explorer.errors import ScenarioError
from tca_explorer.scenario.argument_checks import checked_name, nearest
from tca_explorer.scenario.requests import CALLS
from tca_properties.predicates import Named
from tca_properties.world import Predicate


def accepted(call: str, by: str = "") -> Predicate:
    """With the last action: that central took what a script (of the module *by*) asked for by this call of the module
    library: "kill", "retry", "on_termination", ...; "send" is a message of any class. What is refused, or comes too
    late to change anything, is not accepted; a wait or a lock is accepted when it begins.
    """
    if call not in CALLS:
        raise ScenarioError(f"accepted() knows no call {call!r:.60}; {nearest(str(call), CALLS)}")
    if by:
        checked_name(by, "a module")
    return _Accepted(call, by)


class _Accepted(Named):
    """That a request was taken."""

    def __init__(self, call: str, by: str) -> None:
        super().__init__(f"{call}{f' of {by}' * bool(by)} accepted", module=by)
        self._call = call

    def __call__(self, world: Any) -> list[Any]:
        """That request, if it was taken with the last action."""
        taken = world.taken
        if taken is None or taken.call != self._call:
            return []
        return [taken] if self.module in ("", taken.sender, taken.sender.partition("#")[0]) else []
