"""The base of all facts."""

import msgspec


class BaseFact(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The base of all facts: an array whose first element is the kind. No fact refers to itself, so none is garbage
    that Python has to look for (``gc``): a journal is read faster.
    """
