"""Opens the segments of received bodies."""

from tca_module.large.mappings import memory_of
from tca_wire.errors import ProtocolError
from tca_wire.messages.large_data import OpenedBody
from tca_wire.packets.large import unpack_handle
from tca_wire.vocabulary import Limit

_FAR = (
    "its {size} bytes stand in shared memory, which this module does not share with central; a"
    f" message to it holds at most {Limit.BODY:d}"
)
_GONE = (
    "the data are gone from shared memory: their task has ended, the memory was full,"
    " or the computer was restarted since they were sent"
)


def opened(store: str, body: bytes) -> bytes:
    """Return a large body with the memory of its segment in the folder *store*.

    If the segment can't be read, the body says why when it is decoded.
    """
    try:
        handle, _ = unpack_handle(body)
    except ProtocolError:
        return body  # a decoder reports the damage
    if not handle.segment:
        return body
    found = OpenedBody(body)
    try:
        if store:
            found.content = _memory_of(f"{store}/{handle.segment}", handle.size)
        else:
            found.problem = _FAR.format(size=handle.size)
    except FileNotFoundError:
        found.problem = _GONE
    except OSError as error:
        found.problem = f"its data can't be read: {error}"
    return found


def _memory_of(path: str, size: int) -> memoryview:
    """Return the memory of a segment. Raises what ``memory_of`` does."""
    try:
        return memory_of(path, size)
    except FileNotFoundError:
        # Central has freed it, and its sender has not used it again.
        return memory_of(f"{path}.free", size)
