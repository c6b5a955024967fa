"""A run while it is recorded: records that are only ever added to a file, `.records` beside the
recording.

The format is our own. The packages `mcap` (30 MB with the compressors it needs) and `pyarrow` (170
MB) do not serve. MCAP's reader stops at a flipped byte, Arrow's does not notice one, and neither
forces data to the disk. Their viewers would gain nothing, since a finished run is HDF5.

A record is `HEAD`, a mark with the length and the CRC-32 of what follows, then a line of JSON, then
bytes. After one that is damaged the next mark is searched. The first record is the state, the only
one that is written anew, in its place: a full disk has room for nothing more. The run's header
comes next, twice, since nothing is known of a run without it. The rest are blocks of ticks and
events. Who writes them has a lock on the file as long as it lives.
"""

from __future__ import annotations

import errno
import json
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from haptic_driver.errors import HapticError

HEAD = struct.Struct("<8sII")
MARK = b"\x93haptic\n"
MOST_BYTES = 1 << 24  # of a record
WHY_BYTES = 240
STATE_BYTES = 4096  # JSON takes at most 12 for a character of the reason
NOT_ENDED = "it is being recorded, or its recorder was killed"
PRIVATE = 0o600


def records_of(path: Path) -> Path:
    """Where the records of a run lie that is recorded into `path`."""
    return Path(f"{path}.records")


class TooLongError(HapticError):
    """A record that no reader would take."""


def records_in(descriptor: int) -> Iterator[tuple[dict[str, Any], bytes] | None]:
    """JSON and bytes of each record of an open file; None for a stretch that cannot be read."""
    file, at = _Pieces(descriptor), 0
    vain_bytes = os.fstat(descriptor).st_size + MOST_BYTES  # that may be read for damaged records
    while head := file.read(at, HEAD.size):
        mark, size, crc = HEAD.unpack(head.ljust(HEAD.size))
        body = b""
        if mark == MARK and size <= min(MOST_BYTES, vain_bytes):
            body = os.pread(descriptor, size, at + HEAD.size)
        if body and crc == zlib.crc32(body):
            line, _, data = body.partition(b"\n")
            yield json.loads(line), data
            at += HEAD.size + size
        else:
            yield None
            vain_bytes -= len(body)
            at = file.find(MARK, at + 1)


class _Pieces:
    """A file that is read in pieces, each kept until another is needed."""

    PIECE_BYTES = 1 << 20

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._at, self._piece = descriptor, 0, b""

    def read(self, at: int, size: int) -> bytes:
        """So many bytes, or what there is of them."""
        if not self._at <= at <= at + size <= self._at + len(self._piece):
            self._at, self._piece = at, os.pread(self._descriptor, self.PIECE_BYTES, at)
        return self._piece[at - self._at : at - self._at + size]

    def find(self, mark: bytes, at: int) -> int:
        """Where the mark is next, or the end."""
        while self.read(at, len(mark)):
            found = self._piece.find(mark, at - self._at)
            if found >= 0:
                return self._at + found
            at = max(self._at + len(self._piece) - len(mark) + 1, at + 1)
        return at


def add(descriptor: int, said: dict[str, Any], data: bytes = b"") -> None:
    """Force a record onto the disk. OSError where that cannot be, and nothing stays of it.
    TooLongError for one that nobody would read.
    """
    packed, end = _packed(said, data), os.fstat(descriptor).st_size
    if len(packed) > MOST_BYTES:
        why = f"a record of {len(packed)} bytes is longer than {MOST_BYTES}"
        raise TooLongError("too_long", why)
    try:
        write(descriptor, packed, end)
        os.fsync(descriptor)
    except OSError:
        os.ftruncate(descriptor, end)
        raise


def say(descriptor: int, why: str, count: int) -> None:
    """Write the state: why the run is not whole, if so, and how many ticks it should have."""
    write(descriptor, _packed({"why": why[:WHY_BYTES], "count": count}, line_bytes=STATE_BYTES), 0)
    os.fsync(descriptor)


@contextmanager
def new_file(path: Path, *, replace: bool = False) -> Iterator[int]:
    """A private, locked file that gets its name at the end of the block, when it is on the disk.

    It stays open. FileExistsError where there is another, unless that is to be replaced. The same
    where somebody else has a file of the name that it has until then.
    """
    import fcntl  # noqa: PLC0415 - not on Windows

    part = path.with_name(f".{path.name}.part")
    path.parent.mkdir(parents=True, exist_ok=True)
    _unlink_left(part)
    made = os.open(part, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, PRIVATE)
    try:
        fcntl.flock(made, fcntl.LOCK_EX)
        yield made
        os.fsync(made)
        if not replace and path.exists():
            raise FileExistsError(errno.EEXIST, "another file has taken its place", str(path))
        (os.replace if replace else os.link)(part, path)
    except BaseException:
        os.close(made)
        raise
    finally:
        part.unlink(missing_ok=True)


def _unlink_left(part: Path) -> None:
    """Remove what somebody who was killed here has left; nothing that is another's."""
    with suppress(FileNotFoundError):
        there = part.lstat()
        if stat.S_ISREG(there.st_mode) and there.st_uid == os.geteuid():
            part.unlink()


def remove(path: Path, descriptor: int) -> None:
    """Remove an open file, where it still has this name."""
    with suppress(FileNotFoundError):
        if os.path.samestat(os.stat(path), os.fstat(descriptor)):
            path.unlink()


def copy(source: int, target: int) -> None:
    """All of one open file into another, which is new, with its rights."""
    os.fchmod(target, os.fstat(source).st_mode)
    at = 0
    while sent := os.sendfile(target, source, at, MOST_BYTES):
        at += sent


def write(descriptor: int, data: bytes | memoryview, at: int) -> None:
    """All of it, in as many pieces as the system takes."""
    left = memoryview(data)
    while left:
        written = os.pwrite(descriptor, left, at)
        at, left = at + written, left[written:]


def _packed(said: dict[str, Any], data: bytes = b"", line_bytes: int = 0) -> bytes:
    body = json.dumps(said).encode().ljust(line_bytes) + b"\n" + data
    return HEAD.pack(MARK, len(body), zlib.crc32(body)) + body
