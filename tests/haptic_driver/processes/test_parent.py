"""A child whose parent is gone says nothing: the log of a daemon that was killed held a traceback
for each child.
"""

from __future__ import annotations

import pickle
import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

GIVEN = pickle.dumps({"period_s": 0.001})
HEARS = "from haptic_driver.processes import parent; print(parent.given()['period_s'])"
TELLS = (
    "import sys; sys.stdin.read(); from haptic_driver.processes import parent;"
    " parent.tell({'ready': True})"
)


def started(program: str) -> subprocess.Popen[bytes]:
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", program], stdin=pipe, stdout=pipe, stderr=pipe)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_what_is_handed_over_is_whole_or_the_child_ends(share):
    said, complaints = (child := started(HEARS)).communicate(
        GIVEN[: int(share * len(GIVEN))], timeout=60.0
    )
    assert (child.returncode, said, complaints) == (
        (0, b"0.001\n", b"") if share == 1.0 else (1, b"", b"")
    )


@pytest.mark.parametrize("gone", [False, True])
def test_who_has_nobody_to_tell_that_it_is_ready_ends(gone):
    child = started(TELLS)
    assert child.stdin is not None
    assert child.stdout is not None
    assert child.stderr is not None
    if gone:
        child.stdout.close()
    child.stdin.close()
    assert child.stderr.read() == b""
    assert child.wait(60.0) == (1 if gone else 0)
    if not gone:
        assert child.stdout.read() == b'{"ready": true}\n'
        child.stdout.close()
    child.stderr.close()
