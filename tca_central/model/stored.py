"""The base class of everything that images of the state hold."""

from tca_central.loading import mypyc_attr


@mypyc_attr(serializable=True)
class Stored:
    """A part of the state. An image holds the attributes in ``__slots__``, and no others.

    When an image is read, objects are made without ``__init__`` and filled afterwards. Machine code
    allows this only for classes that are declared serializable. With mypyc
    2.4, only machine code can then create such objects normally. That is enough, because central
    creates all of them in machine code.
    """

    __slots__ = ()
