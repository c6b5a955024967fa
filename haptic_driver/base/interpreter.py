"""How every process of this program is started: by this interpreter, and by nobody else's files.

The folder in which a command was typed may be anybody's. Python looks there first for what `-m` and
`-c` import, and a `queue.py` in it would run in the process that switches off.
"""

from __future__ import annotations

import sys

# -P: the present folder is not searched.
PYTHON = (sys.executable, "-P")


def module_command(module: str) -> list[str]:
    """The command that runs a module of this program; its arguments follow."""
    return [*PYTHON, "-m", module]
