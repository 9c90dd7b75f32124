"""What can be known of users' functions before they are called."""

import inspect
from collections.abc import Callable, Sequence


def is_async(function: Callable[..., object]) -> bool:
    """Whether it is an ``async def`` function, or an object that is called like one."""
    called = getattr(function, "__call__", None)  # noqa: B004
    return any(map(inspect.iscoroutinefunction, (function, called)))


def arguments_taken(function: Callable[..., object], possible: Sequence[int]) -> int | None:
    """The first of these numbers of arguments that it can be called with; None: with none of them.

    Of a function that says nothing about itself, such as some written in C, the last is believed.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return possible[-1]
    return next((number for number in possible if _fits(signature, number)), None)


def _fits(signature: inspect.Signature, arguments: int) -> bool:
    try:
        signature.bind(*(None,) * arguments)
    except TypeError:
        return False
    return True
