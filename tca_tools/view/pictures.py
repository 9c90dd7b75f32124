"""Pictures that modules publish: shared variables with a name like "picture of the arm": SVG text,
or PNG bytes.
"""

from base64 import b64encode
from contextlib import suppress

import msgspec

from tca_tools.journal.records import Message

PICTURE_OF = "picture of "
"""The beginning of the names."""

_PNG = b"\x89PNG\r\n\x1a\n"


def is_picture(message: Message) -> bool:
    """Whether a message gave a variable a value that is a picture by its name."""
    return message.message_class.keeps_value and message.name.startswith(PICTURE_OF)


def picture_in(message: Message) -> dict[str, str]:
    """The picture that came with a message, as the address of an image; or why it can't be
    shown.
    """
    with suppress(msgspec.MsgspecError):
        match msgspec.msgpack.decode(message.body):
            case str() as text if "<svg" in text:
                return _image("svg+xml", text.encode())
            case bytes() as data if data.startswith(_PNG):
                return _image("png", data)
    return {"problem": "this value is neither SVG as text nor PNG as bytes"}


def _image(kind: str, data: bytes) -> dict[str, str]:
    return {"image": f"data:image/{kind};base64,{b64encode(data).decode()}"}
