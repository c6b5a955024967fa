"""What it costs to start: CPU time of whole commands against that of a bare `import numpy`, warm
caches.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from benchmarks.claim import Claim

ROUNDS = 7
HAPTIC = str(Path(sys.executable).with_name("haptic"))
NUMPY = [sys.executable, "-c", "import numpy"]
MOST = {  # times `import numpy`
    "--help": 3,
    "--version": 3,
    "status": 3,
    "texture list": 4,
    "solve --friction 0.6": 8,
}


def run() -> Iterator[Claim]:
    for words, most in MOST.items():
        with daemon() if words == "status" else nullcontext():
            ratio = against_numpy([HAPTIC, *words.split()])
        what = f"CPU time of `haptic {words}` against `import numpy`"
        yield Claim(what, f"{ratio:.1f} times", f"at most {most} times", ratio <= most)


def against_numpy(command: list[str]) -> float:
    """Median ratio, each run beside one of numpy's: a busy or throttled machine slows both."""
    cpu_s(command)  # what is compiled at first use
    return statistics.median(cpu_s(command) / cpu_s(NUMPY) for _ in range(ROUNDS))


def cpu_s(command: list[str]) -> float:
    """User and system time of a process that ended well, and of those that it waited for."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return used.ru_utime + used.ru_stime


@contextmanager
def daemon() -> Iterator[None]:
    """A daemon of the simulated rig for `haptic status`, idle."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HAPTIC_SOCKET"] = str(Path(folder) / "d.sock")
        command = [HAPTIC, "daemon", "run", "--json"]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()  # it says so when it is ready
            try:
                yield
            finally:
                process.terminate()
                del os.environ["HAPTIC_SOCKET"]
