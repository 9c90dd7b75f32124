"""Errors of the explorer.

Calls in a script raise the module library's errors, as on the robot. The explorer has its own, too.

ExplorerError        groups the others; neither raised nor caught itself
├── ScenarioError    a scenario can't be played; the text says where, why and what to do
└── CentralFault     central raised an error; the result of the exploration reports this bug
"""


class ExplorerError(Exception):
    """Base of all errors of this package."""


class ScenarioError(ExplorerError):
    """A scenario can't be played: it, or one of its scripts, has a mistake."""


class CentralFault(ExplorerError):
    """Central raised an error while handling an event."""
