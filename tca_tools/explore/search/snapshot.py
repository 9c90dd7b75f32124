"""A play as bytes, to go on from it more than once: faster than playing it again, however long the run.

Pickle copies what a play holds, except what all plays share (the scenario, its programs, what scripts have lived, the
rules and life cycles of tasks): that is named by its number in memory, so snapshots are good for this process only.
Functions inside central that know their central are made anew for the copy.
"""

import io
import pickle
import sys
from collections.abc import Callable
from threading import Lock
from types import CellType, CodeType, FunctionType, MethodType
from typing import Any
from weakref import WeakValueDictionary

from tca_tools.explore.play.identifiers import MessageId, RequestNumber
from tca_tools.explore.play.play import Play
from tca_tools.explore.scenario.scenario import Scenario, ScenarioModule
from tca_tools.explore.scenario.script import Program
from tca_tools.explore.scenario.steps import Branch, ScriptRun
from tca_wire.life_cycles import LifeCycle
from tca_wire.messages.declarations import Message
from tca_wire.rules import TaskRules

_SHARED = (Scenario, ScenarioModule, Program, ScriptRun, Branch, Message, LifeCycle, TaskRules, CodeType, FunctionType)

_EMPTY: dict[type, Callable[[], Any]] = {type(Lock()): Lock, WeakValueDictionary: WeakValueDictionary}
"""Of a slot's session: nothing of a scenario is in these."""

_ATOMS = (MessageId, RequestNumber)


class Snapshots:
    """Makes snapshots, and plays of them."""

    def __init__(self) -> None:
        self._shared: dict[int, Any] = {}  #: by id(); kept, so that the ids stay theirs

    def save(self, play: Play) -> bytes:
        """A play that can be had again."""
        out = io.BytesIO()
        _Pickler(out, self._shared).dump(play)
        return out.getvalue()

    def load(self, snapshot: bytes) -> Play:
        """A play as it was when it was saved."""
        _loading.append(self._shared)
        try:
            found: Play = pickle.loads(snapshot)  # noqa: S301 - it is our own
        finally:
            _loading.pop()
        return found


class _Pickler(pickle.Pickler):
    def __init__(self, out: io.BytesIO, shared: dict[int, Any]) -> None:
        super().__init__(out, pickle.HIGHEST_PROTOCOL)
        self._shared = shared

    def reducer_override(self, thing: Any) -> Any:
        """Called for all but plain values."""
        kind = type(thing)
        if kind in _ATOMS:
            return kind, (int(thing),)
        if kind is MethodType:
            return _method, (thing.__func__, thing.__self__)
        if kind is FunctionType and thing.__closure__ is not None:  # it knows something of its central
            cells = tuple(cell.cell_contents for cell in thing.__closure__)
            return _function, (thing.__code__, thing.__module__, cells, thing.__defaults__)
        if kind in _EMPTY:
            return _EMPTY[kind], ()
        if isinstance(thing, _SHARED) and thing not in _OURS:
            self._shared[id(thing)] = thing
            return _known, (id(thing),)
        return NotImplemented


_loading: list[dict[int, Any]] = []
"""The objects shared with the snapshot that is being loaded."""


def _known(number: int) -> Any:
    return _loading[-1][number]


def _method(function: FunctionType, thing: Any) -> MethodType:
    return MethodType(function, thing)


def _function(code: CodeType, module: str, contents: tuple[Any, ...], defaults: Any) -> FunctionType:
    cells = tuple(map(CellType, contents))
    return FunctionType(code, vars(sys.modules[module]), code.co_name, defaults, cells)


_OURS = (_known, _method, _function)
