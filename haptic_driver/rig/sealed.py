"""What only a simulated finger has, written so that nobody reads it by looking.

It is packed, not encrypted: the simulator must open it, and so can whoever writes a program.
"""

from __future__ import annotations

import base64
import zlib

from pydantic import Field, FiniteFloat

from haptic_driver.config import Section

MOST_BYTES = 100_000  # unpacked: a file may come from anybody


class Hidden(Section):
    """Effects by name with their parameters, and numbers of the finger itself."""

    hide: dict[str, dict[str, FiniteFloat]] = Field(default={})
    finger: dict[str, FiniteFloat] = Field(default={})


def seal(hidden: Hidden) -> str:
    """One word for a rig's file; none for nothing."""
    if hidden == Hidden():
        return ""
    return base64.urlsafe_b64encode(zlib.compress(hidden.model_dump_json().encode())).decode()


def opened(sealed: str) -> Hidden:
    """What was sealed, nothing for nothing; ValueError where the text was altered, of which it says
    nothing else.
    """
    if not sealed:
        return Hidden()
    try:
        packed = base64.b64decode(sealed, b"-_", validate=True)
        unpacker = zlib.decompressobj()
        content = unpacker.decompress(packed, MOST_BYTES)
        return Hidden.model_validate_json(content if unpacker.eof else b"")
    except (ValueError, zlib.error):
        raise ValueError("is not as `haptic exercise make` wrote it; copy it anew") from None
