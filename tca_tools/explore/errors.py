"""Errors of the explorer. What scripts may catch are the module library's errors: they raise what
they do on the robot.

ExplorerError        do not raise or catch this one; it groups the others
├── ScenarioError    a scenario can't be played: what, where, what to do
└── CentralFault     central raised something: a bug in central, which the result of an exploration
shows
"""


class ExplorerError(Exception):
    """Base of all errors of this package."""


class ScenarioError(ExplorerError):
    """A scenario can't be played."""


class CentralFault(ExplorerError):
    """Central raised something that it should not."""
