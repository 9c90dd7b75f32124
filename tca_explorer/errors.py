"""Errors of the explorer.

ExplorerError        do not raise or catch this one; it groups the others
├── ScenarioError    a scenario can't be played: what, where, what to do
├── CentralFault     central raised something: a bug in central, which the result of an exploration shows
├── QueryFailed      raised in a script: the handler of its query failed, or was lost
└── Refused          raised in a script: central refused what it asked for
"""

from tca_wire.vocabulary import Refusal


class ExplorerError(Exception):
    """Base of all errors of this package."""


class ScenarioError(ExplorerError):
    """A scenario can't be played."""


class CentralFault(ExplorerError):
    """Central raised something that it should not."""


class QueryFailed(ExplorerError):
    """The handler of a query failed: ``failure`` is the failure's name."""

    def __init__(self, message: str, failure: str) -> None:
        super().__init__(f"query '{message}' failed: {failure}")
        self.failure = failure


class Refused(ExplorerError):
    """Central refused a request of a script; nothing of it remains."""

    def __init__(self, what: str, refusal: Refusal) -> None:
        super().__init__(f"{what} was refused: {refusal}")
        self.refusal = refusal
