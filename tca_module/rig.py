"""A rig: modules and fakes that run in the process of a test, beside its central."""

import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from tca_module import checks
from tca_module.errors import BadData, MisuseError, Timeout
from tca_module.link.opening import CentralAddress
from tca_module.module import Module
from tca_module.sending.task import Task
from tca_module.serving.annotations import check_annotations
from tca_wire.messages.declarations import Failure, Message
from tca_wire.vocabulary import Limit

_SOON = 5.0  # seconds of real time

_FAILURE = checks.instance_of(
    "a failure or an exception, such as TOO_HEAVY(8.5)", Failure | Exception
).or_none()
_MODULES = checks.list_of(
    "modules, such as start(wheels, planner)", checks.instance_of("a module", Module)
)


class Fake:
    """A stand-in for the handler of a message, made by ``fake()`` of a test's central.

    Attributes:
        message: the message.
        calls: the data of each call, in order; None for a message without data.

    Example::

        lift = tca_central.fake(LIFT)
        planner.goal(FETCH, "cup").wait(timeout=5)
        assert lift.calls == ["cup"]
    """

    def __init__(self, message: Message[Any, Any], returns: Any, fails: Any) -> None:
        checks.check("fake()", checks.MESSAGE, message=message)
        self.message = message
        self.calls: list[Any] = []
        self._called = threading.Condition()
        self._answer = self._answer_of(returns, fails)

    def __repr__(self) -> str:
        return f"the fake of {self.message.title}"

    def __call__(self, task: Task, data: Any = None) -> Any:
        """Record a call, and answer it."""
        with self._called:
            self.calls.append(data)
            self._called.notify_all()
        answer = self._answer(task, data)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def wait_for_calls(self, number: int, *, timeout: float | None = _SOON) -> list[Any]:
        """Wait until the fake has been called.

        Args:
            number: the number of calls since the start of the fake, 1 or more.
            timeout: the most seconds of real time to wait; None: for ever. Default: 5.

        Returns:
            The data of each call, in order.

        Raises:
            Timeout: there were fewer calls; the text tells their number.
            MisuseError: an argument has the wrong type or range.

        Example::

            assert say.wait_for_calls(2) == ["left", "right"]
        """
        checks.check("wait_for_calls()", checks.COUNT, number=number)
        checks.check("wait_for_calls()", checks.TIMEOUT, timeout=timeout)
        with self._called:
            if not self._called.wait_for(lambda: len(self.calls) >= number, timeout):
                text = f"{self!r} was called {len(self.calls)} of {number} times"
                raise Timeout(f"{text} within {timeout:g} s", can_wait=True)
            return self.calls[:]

    def _answer_of(self, returns: Any, fails: Any) -> Callable[[Task, Any], Any]:
        """Return the function that answers a call. Raises MisuseError and BadData."""
        what = f"fake of {self.message.title}"
        checks.check(what, _FAILURE, fails=fails)
        if fails is not None and returns is not None:
            raise MisuseError(f"{what}: leave out returns= or fails=: a call has one answer")
        if fails is not None:
            failure = _raised(what, fails)
            return lambda _task, _data: failure
        if isinstance(returns, list):
            return self._answer_in_turn(what, returns)
        if callable(returns):
            return self._answer_by(what, returns)
        self._check(what, returns)
        return lambda _task, _data: returns

    def _answer_in_turn(self, what: str, values: list[Any]) -> Callable[[Task, Any], Any]:
        """Return a function that gives each call its own value."""
        values = [_raised(what, one) if isinstance(one, Failure) else one for one in values]
        for number, value in enumerate(values, 1):
            self._check(f"{what}, call {number}", value)

        def answer(_task: Task, _data: Any) -> Any:
            if len(self.calls) > len(values):
                text = f"{what}: call {len(self.calls)} has no value"
                raise MisuseError(f"{text}: give returns=[...] a value for each call")
            return values[len(self.calls) - 1]

        return answer

    def _answer_by(self, what: str, function: Callable[..., Any]) -> Callable[[Task, Any], Any]:
        """Return a function that calls the user's *function* as a handler."""
        has_data = self.message.data.kind is not type(None)
        wanted = f"(task, data: {self.message.data})" if has_data else "(task)"
        number = checks.check_function(f"{what}: returns=", function, wanted, (1 + has_data,))
        check_annotations(f"{what}: returns=", function, self.message)
        return lambda task, data: function(*(task, data)[:number])

    def _check(self, what: str, value: Any) -> None:
        """Raise BadData if the message's handler can't return *value*."""
        if isinstance(value, Exception):
            return
        try:
            self.message.reply.encode(value)
        except BadData as error:
            advice = f"give returns= a value of type {self.message.reply}"
            raise BadData(f"{what}: {advice}: {error}") from None


def _raised(what: str, failure: Failure[Any] | Exception) -> Exception:
    """Return the exception to raise for a failure."""
    if isinstance(failure, Exception):
        return failure
    try:
        return failure()
    except BadData as error:
        raise BadData(f"{what}: {error}: give the failure with its data") from None


class Rig:
    """Modules and fakes of a test. All end with the test's central, the newest first."""

    def __init__(self, central: CentralAddress) -> None:
        self._central = central
        self._modules = ExitStack()
        self._fakes: list[Fake] = []

    def start(self, *modules: Module) -> None:
        """Run modules in the process of the test, until the test's central closes.

        The modules use this central, even if they were made with another. The calling thread may
        send with them.

        Args:
            modules: the modules, in the order of their starts. A module that requires messages
                starts after the modules that handle them.

        Raises:
            MisuseError: an argument is not a module, a module runs already, or a LocalCentral has
                no handler of a message that a module requires.
            CentralLost: central does not answer.

        Example::

            tca_central.start(wheels, planner)
            assert planner.goal(FETCH, "cup").wait(timeout=5) is Outcome.DONE
        """
        checks.check("start()", _MODULES, modules=modules)
        for module in modules:
            self._check_required(module)
            self._modules.callback(setattr, module, "central", module.central)
            module.central = self._central
            self._modules.enter_context(module.running())

    def _check_required(self, module: Module) -> None:
        """Raise MisuseError if a message that the module requires will never get a handler."""

    def fake(self, message: Message[Any, Any], *, returns: Any = None, fails: Any = None) -> Fake:
        """Handle a message in place of its module, until the test's central closes.

        The newest handler gets all messages. Therefore a fake also replaces the handler of a module
        that runs, and an earlier fake.

        Args:
            message: the message to handle.
            returns: the reply or result of every call; or a list with the value of each call,
                failures among them; or a function that is called as the handler. Default: None.
            fails: the failure of every call, or an exception. A failure with data is given as
                TOO_HEAVY(8.5). Default: None.

        Returns:
            The fake, which records its calls.

        Raises:
            BadData: a value is not of the message's type.
            MisuseError: an argument is wrong, or the message has no handlers.

        Example::

            weigh = tca_central.fake(WEIGH, returns=[3.0, TOO_HEAVY(8.5)])
            tca_central.fake(LIFT, fails=SLIPPED)
            tca_central.fake(HEIGHT, returns=lambda task, place: 0.1 * place.x)
        """
        fake = Fake(message, returns, fails)
        number = sum(one.message.name == message.name for one in self._fakes)
        name = f"fake of {message.name}"[: Limit.NAME - 4]
        module = Module(f"{name} {number + 1}" if number else name)
        module.handles(message)(fake)
        self.start(module)
        self._fakes.append(fake)
        return fake

    def close(self) -> None:
        """End the modules and fakes. Closing again does nothing."""
        self._modules.close()
