"""A file for h5py to write to, of which no failed write is lost: HDF5 prints what the system says,
and goes on.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer, WriteableBuffer


class CheckedFile(io.RawIOBase):
    """An existing file, read and written. The end of its block forces it to disk and raises the
    first OSError.

    What fails meanwhile is only remembered, since HDF5 does not stop for it: the file is then good
    for nothing.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self._at = 0
        self._error: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        """Where the next byte goes."""
        return self._at

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = os.lseek(self._descriptor, offset, whence) if whence == os.SEEK_END else offset
        return self._at

    def readinto(self, buffer: WriteableBuffer) -> int:
        """What is there, up to the end of the file."""
        room = memoryview(buffer).cast("B")
        found = os.pread(self._descriptor, len(room), self._at)
        room[: len(found)] = found
        self._at += len(found)
        return len(found)

    def write(self, data: ReadableBuffer) -> int:
        """All of it, in as many pieces as the system takes."""
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while left and self._error is None:
                written = os.pwrite(self._descriptor, left, self._at)
                self._at, left = self._at + written, left[written:]
        except OSError as error:
            self._error = error
        self._at += len(left)
        return size

    def truncate(self, size: int | None = None) -> int:
        """Make it so long."""
        size = self._at if size is None else size
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as error:
            self._error = self._error or error
        return size

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """To the disk; raises what the system refused first."""
        try:
            if self._error is None:
                os.fsync(self._descriptor)
        finally:
            os.close(self._descriptor)
        if self._error is not None:
            raise self._error
