"""The user data of a machine, and the states that are plain Python."""

from collections.abc import Callable, Iterable, Mapping, MutableMapping
from typing import Any, Never, TypeVar

from tca_module import MisuseError
from tca_module.checks import LABEL, check, list_of
from tca_module.log import log_of

F = TypeVar("F", bound="Callable[[UserData], str | None]")

_PACKAGE = "tca_behaviours."
OUTCOMES = list_of('a list of names, such as ["found", "lost"]', LABEL)


class UnknownUserData(MisuseError, AttributeError):
    """A state reads user data that has not been set."""


class UserData:
    """The data of a running machine, as one state sees them: ``data.counter += 1``.

    All states of a machine share the data. The ``remap`` of a state, and of the containers around
    it, gives them other names there.
    """

    __slots__ = ("_names", "_state", "_values")

    def __init__(
        self, values: MutableMapping[str, Any], state: str, names: Iterable[Mapping[str, str]]
    ) -> None:
        """*values*: the machine's data. *state*: the state, for errors. *names*: the state's
        ``remap`` and those of its containers, innermost first.
        """
        for name, value in (("_values", values), ("_state", state), ("_names", list(names))):
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Any:
        key = self._key(name)
        if key not in self._values:
            known = ", ".join(map(repr, self._values)) or "none"
            raise UnknownUserData(
                f"state {self._state} reads user data {key!r}, which are not set: "
                f"give them to run(data=...), or set them in an earlier state; set are {known}"
            )
        return self._values[key]

    def __contains__(self, name: str) -> bool:
        return self._key(name) in self._values

    def __setattr__(self, name: str, value: Any) -> None:
        self._values[self._key(name)] = value

    def __delattr__(self, name: str) -> None:
        getattr(self, name)  # raises UnknownUserData
        del self._values[self._key(name)]

    def _key(self, name: str) -> str:
        for names in self._names:
            name = names.get(name, name)
        return name


def log_error(what: str, error: Exception) -> None:
    """Log an error of a user's function, with the part of the traceback below this package."""
    trace = error.__traceback__
    while trace is not None and trace.tb_frame.f_globals["__name__"].startswith(_PACKAGE):
        trace = trace.tb_next
    log_of("machine").warning("%s raised an error", what, exc_info=error.with_traceback(trace))


class FromData:
    """A parameter of a task that is read from the user data when the task begins.

    Args:
        name: the name of the user data.

    Example::

        sm.GoTo(goal_x=FromData("x"))
    """

    def __init__(self, name: str) -> None:
        check("FromData", LABEL, name=name)
        self.name = name

    def __repr__(self) -> str:
        return f"data.{self.name}"


def state(*unnamed: Never, outcomes: Iterable[str] = ()) -> Callable[[F], F]:
    """Declare the outcomes of a function that is a state of machines: ``sm.call(function)``.

    Args:
        unnamed: nothing: the outcomes are given by name.
        outcomes: the values that the function may return.

    Returns:
        A decorator for the function, which takes the UserData.

    Raises:
        MisuseError: the outcomes are not a list of names.

    Example::

        @state(outcomes=["again", "enough"])
        def count(data: UserData) -> str:
            data.counter += 1
            return "again" if data.counter < 3 else "enough"
    """
    if unnamed or not outcomes:
        given = f"not {unnamed[0]!r:.60}" if unnamed else "and there are none"
        raise MisuseError(f"@state takes outcomes by name, {given}: write @state(outcomes=[...])")
    check("state", OUTCOMES, outcomes=outcomes)

    def mark(function: F) -> F:
        function.outcomes = tuple(outcomes)  # type: ignore[attr-defined]  # read by call()
        return function

    return mark
