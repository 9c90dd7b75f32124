"""What a module declares, in as many requests as central takes at a time."""

from collections.abc import Iterable, Iterator

from tca_wire.packets.headers import Register
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import Limit

_MOST = int(Limit.LIST) // 2  # declarations in a request: everybody else waits for it
_BYTES = int(Limit.HEADER) // 2


def registers(
    messages: Iterable[MessageFormat],
    handlers: Iterable[HandlerFormat] = (),
    *,
    is_ready: bool = False,
) -> list[Register]:
    """The requests that declare messages and handlers, to be made in this order; most times one."""
    messages, handlers = list(messages), list(handlers)
    if len(messages) + len(handlers) <= _MOST and sum(map(_size, messages)) <= _BYTES:
        return [Register(0, messages, handlers, is_ready)]
    of_handlers = [handlers[at : at + _MOST] for at in range(0, len(handlers), _MOST)] or [[]]
    declared = [Register(0, some) for some in _divided(messages)]
    handled = [Register(0, [], some) for some in of_handlers[:-1]]
    return [*declared, *handled, Register(0, [], of_handlers[-1], is_ready)]


def _divided(messages: list[MessageFormat]) -> Iterator[list[MessageFormat]]:
    some: list[MessageFormat] = []
    size = 0
    for message in messages:
        if some and (len(some) == _MOST or size + _size(message) > _BYTES):
            yield some
            some, size = [], 0
        some.append(message)
        size += _size(message)
    yield some


def _size(message: MessageFormat) -> int:
    return len(message.data.encode()) + len(message.reply.encode())
