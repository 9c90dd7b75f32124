"""The base of all classes whose objects make up the state, so that an image can hold them."""

from tca_central.loading import mypyc_attr


@mypyc_attr(serializable=True)
class Stored:
    """A part of the state, but for the whole. Its attributes are those of ``__slots__``: an image
    holds no others.

    An image's are made without ``__init__``, and filled when all are there. Machine code allows
    that to classes that are declared so; then only machine code can make them as usual (mypyc 2.4),
    so central makes all its objects itself.
    """

    __slots__ = ()
