"""Splits declarations into requests that central accepts."""

from collections.abc import Iterable, Iterator

from tca_wire.packets.headers import Register
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import Limit

# The most declarations, and the most bytes of formats, in one request. Central would accept more,
# but handles nothing else at the same time.
_MOST = int(Limit.LIST) // 2
_MOST_BYTES = int(Limit.HEADER) // 2


def register_headers(
    messages: Iterable[MessageFormat],
    handlers: Iterable[HandlerFormat] = (),
    *,
    is_ready: bool = False,
) -> list[Register]:
    """Return the requests that declare messages and handlers, in order; mostly one."""
    messages, handlers = list(messages), list(handlers)
    if len(messages) + len(handlers) <= _MOST and sum(map(_size, messages)) <= _MOST_BYTES:
        return [Register(0, messages, handlers, is_ready)]
    parts = [handlers[at : at + _MOST] for at in range(0, len(handlers), _MOST)] or [[]]
    declared = [Register(0, part) for part in _split(messages)]
    handled = [Register(0, [], part) for part in parts[:-1]]
    # The last request says *is_ready*: everything else is declared by then.
    return [*declared, *handled, Register(0, [], parts[-1], is_ready)]


def _split(messages: list[MessageFormat]) -> Iterator[list[MessageFormat]]:
    part: list[MessageFormat] = []
    size = 0
    for message in messages:
        if part and (len(part) == _MOST or size + _size(message) > _MOST_BYTES):
            yield part
            part, size = [], 0
        part.append(message)
        size += _size(message)
    yield part


def _size(message: MessageFormat) -> int:
    return len(message.data.encode()) + len(message.reply.encode())
