"""Constructors whose errors are about the class that was called, and show how to write it."""

import inspect
from typing import TYPE_CHECKING, Any


class Declaring(type):
    """The class of declarations: arguments that don't fit are refused in words of the declaration, whichever base has
    its constructor.
    """

    @property
    def __signature__(cls) -> inspect.Signature:
        """The arguments of the class itself, for ``help``."""
        signature = inspect.signature(cls.__init__)  # type: ignore[misc]  # of the class itself
        return signature.replace(parameters=list(signature.parameters.values())[1:])

    # A type checker that saw this method would take every declaration for Any: it reads the classes' own __init__.
    if not TYPE_CHECKING:

        def __call__(cls, *arguments: Any, **options: Any) -> Any:
            """Make one. Raises TypeError."""
            signature = cls.__signature__
            try:
                signature.bind_partial(*arguments, **options)  # a wrong name is worse than a missing one
                signature.bind(*arguments, **options)
            except TypeError as error:
                what = str(error).replace(" keyword-only", "")
                raise TypeError(f"{cls.__name__}(): {what}: write {cls.__name__}{_form(signature)}") from None
            return super().__call__(*arguments, **options)


def _form(signature: inspect.Signature) -> inspect.Signature:
    """The arguments without their types."""
    plain = [one.replace(annotation=inspect.Parameter.empty) for one in signature.parameters.values()]
    return inspect.Signature(plain)
