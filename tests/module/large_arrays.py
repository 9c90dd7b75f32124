"""Arrays that are large enough for a segment, and that receivers map."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tca_wire.messages.formats import Format
from tca_wire.messages.large_data import LargeData
from tca_wire.packets.large import LARGE

ARRAY: Format[Any] = Format(np.ndarray)
RUN = "ab12"
SIZE = 12 * LARGE


def array(value: int, size: int = SIZE) -> NDArray[np.uint8]:
    return np.full(size, value, np.uint8)


def encoded(value: int, size: int = SIZE) -> LargeData:
    body = ARRAY.encode(array(value, size))
    assert isinstance(body, LargeData)
    return body
