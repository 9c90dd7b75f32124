"""Pictures that modules publish: shared variables with a name like "picture of the arm": SVG text, or PNG bytes."""

from base64 import b64encode

import msgspec

from tca_tools.journal.records import Message

PICTURE_OF = "picture of "
"""The beginning of the names."""

_PNG = b"\x89PNG\r\n\x1a\n"


def is_picture(message: Message) -> bool:
    """Whether a message gave a variable a value that is a picture by its name."""
    return message.message_class.keeps_value and message.name.startswith(PICTURE_OF)


def picture_in(message: Message) -> dict[str, str]:
    """The picture that came with a message, as the address of an image; or why it can't be shown."""
    kind, data = _read(message.body)
    if not kind:
        return {"problem": "this value is neither SVG as text nor PNG as bytes"}
    return {"image": f"data:{kind};base64,{b64encode(data).decode()}"}


def _read(body: bytes) -> tuple[str, bytes]:
    """The kind of a picture and its bytes; of anything else an empty kind."""
    try:
        value = msgspec.msgpack.decode(body)
    except msgspec.MsgspecError:
        return "", b""
    if isinstance(value, str) and "<svg" in value:
        return "image/svg+xml", value.encode()
    if isinstance(value, bytes) and value.startswith(_PNG):
        return "image/png", value
    return "", b""
