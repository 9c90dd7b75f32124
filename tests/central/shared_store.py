"""A store of large data in a folder of its own, and the segments of one module."""

import gc
from pathlib import Path

from tca_central.shell.kept_data import KeptData
from tca_central.shell.store import Store
from tca_wire.packets.large import Handle, pack_handle

DATA = bytes(range(256)) * 400
MODULE = "a1"


class Shared:
    """A store in a folder of its own, and the segments of one module."""

    def __init__(self, root: Path, epoch: str = "run", kept: KeptData | None = None) -> None:
        self.store = Store(root)
        self.store.open(epoch, kept)
        assert self.store.folder is not None
        self.folder = self.store.folder
        self.modules = {MODULE}

    def write(self, name: str, data: bytes = DATA, keep: int = 0) -> bytes:
        """Write a segment as its sender does. Return the body of its message."""
        path = self.folder / f"{name}.new"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        return handle(name, len(data), keep)

    def files(self) -> list[str]:
        """Return the names of all segments, after all releases."""
        gc.collect()
        self.store.settle(self.modules)
        return sorted(
            str(path.relative_to(self.folder)) for path in self.folder.glob("*/*") if path.is_file()
        )

    def sweep(self) -> None:
        """Do what central does each second, and wait until folders of dead centrals are removed."""
        self.store._next_cleaning = 0.0
        self.store.settle(self.modules)
        self.store.sweep(self.modules)
        assert self.store._dead is not None
        assert self.store._dead._thread is not None
        self.store._dead._thread.join()

    def kill(self) -> None:
        """Leave the folder as a killed central does."""
        self.store._close_lock()

    def close(self) -> None:
        self.store.close(is_over=False)


def handle(name: str, size: int = len(DATA), keep: int = 0) -> bytes:
    return pack_handle(Handle(name, size, keep, b"\xc0"))
