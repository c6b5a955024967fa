"""The command line from a script or a notebook."""

from __future__ import annotations

import shlex

from haptic_driver.errors import HapticError


def command(line: str) -> None:
    """Run a command as a terminal would, such as `texture check linen`, and print what it prints.

    HapticError where it fails; the reason is printed before.
    """
    from haptic_driver.cli.main import main  # noqa: PLC0415  (compiling starts there)

    words = shlex.split(line)
    if status := main(words[1:] if words[:1] == ["haptic"] else words):
        raise HapticError("command_failed", f"haptic {line}: ended with status {status}")
