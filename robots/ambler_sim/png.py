"""Writing PNG pictures with the standard library alone."""

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"
EIGHT_BIT_RGB = (8, 2, 0, 0, 0)
NO_FILTER = 0


def write_png(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write (height, width, 3) pixels."""
    height, width, _ = pixels.shape
    header = struct.pack(">2I5B", width, height, *EIGHT_BIT_RGB)
    filters = np.full((height, 1), NO_FILTER, dtype=np.uint8)
    rows = np.hstack([filters, pixels.reshape(height, width * 3)])
    body = zlib.compress(rows.tobytes(), level=9)
    path.write_bytes(SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", body) + _chunk(b"IEND", b""))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
