"""Typed ports: the only way into a component and out of it."""

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from tca_module import MisuseError

T = TypeVar("T")


class _Port(Generic[T]):
    """The common part of ports."""

    def __init__(self, component: str, name: str, type_: type[T]) -> None:
        if not isinstance(type_, type):
            raise MisuseError(
                f"{component}.{name}: the type of a port is a class, not {type_!r:.60}"
            )
        self.component = component
        self.name = name
        self.type = type_
        # float includes int, as in type hints.
        self._classes = (type_, int) if type_ is float else (type_,)

    def __repr__(self) -> str:
        return f"{self.component}.{self.name} ({self.type.__name__})"

    def _check(self, value: T) -> None:
        if not isinstance(value, self._classes):
            raise MisuseError(
                f"port {self!r} does not accept {value!r:.60}, of type {type(value).__name__}"
            )


class InputPort(_Port[T]):
    """Holds the newest *keep* values. The port handler of the component passes them to *take*, one
    by one.
    """

    def __init__(
        self, component: str, name: str, type_: type[T], take: Callable[[T], object], keep: int = 1
    ) -> None:
        super().__init__(component, name, type_)
        if keep < 1:
            raise MisuseError(f"port {self!r}: keep must be 1 or more, not {keep}")
        self.lost = 0  #: the number of values that newer ones have replaced
        self._take = take
        self._arrived: deque[T] = deque(maxlen=keep)

    def put(self, value: T) -> None:
        """Receive a value. Thread-safe.

        Args:
            value: the value.

        Raises:
            MisuseError: its type does not fit.
        """
        self._check(value)
        self.lost += len(self._arrived) == self._arrived.maxlen
        self._arrived.append(value)

    def deliver_arrived(self) -> None:
        """Pass the values that have arrived so far to the component."""
        for _ in range(len(self._arrived)):
            self._take(self._arrived.popleft())

    def clear(self) -> None:
        """Drop the values that have arrived."""
        self._arrived.clear()
        self.lost = 0

    def fits(self, output: "_Port[T]") -> bool:
        """Return whether all values of an output port fit here.

        Args:
            output: the output port.
        """
        return issubclass(output.type, self._classes)


class OutputPort(_Port[T]):
    """Passes each value that is set to the connected input ports."""

    def __init__(self, component: str, name: str, type_: type[T]) -> None:
        super().__init__(component, name, type_)
        self.value: T | None = None  #: the newest value
        self._receivers: list[Callable[[T], object]] = []

    def set(self, value: T) -> None:
        """Pass a value to the connected ports.

        Args:
            value: the value.

        Raises:
            MisuseError: its type does not fit.
        """
        self._check(value)
        self.value = value
        for function in self._receivers:
            function(value)

    def on_set(self, function: Callable[[T], object]) -> None:
        """Call a function with each value, in the tick that sets it.

        Args:
            function: a function that takes the value. It must be short.
        """
        self._receivers.append(function)

    def clear(self) -> None:
        """Drop the newest value."""
        self.value = None


def connect(output: OutputPort[T], input_: InputPort[T]) -> None:
    """Connect an output port with an input port: all values set at *output* arrive at *input_*.

    Args:
        output: the output port.
        input_: the input port.

    Raises:
        MisuseError: their types do not fit, or one is no such port.
    """
    if not isinstance(output, OutputPort) or not isinstance(input_, InputPort):
        raise MisuseError(
            "connect() needs an output port and an input port, "
            f"not {output!r:.60} and {input_!r:.60}"
        )
    if not input_.fits(output):
        raise MisuseError(
            f"port {output!r} can't be connected with {input_!r}: give both the same type"
        )
    output.on_set(input_.put)
