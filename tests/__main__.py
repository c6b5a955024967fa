"""All tests, a kind after the other: `python -m tests [--quick] [arguments of pytest]`.

As many run at once as there are cores. Tests of real time run alone.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

from haptic_driver.cli.main import main as haptic
from tests import kinds

CORES = len(os.sched_getaffinity(0))
KINDS = {
    "pure": ("not process and not realtime and not soak", CORES),
    "process": ("process and not realtime and not soak", CORES),
    "realtime": ("realtime and not soak", 1),
}
NOTHING_COLLECTED = 5


class Counts(NamedTuple):
    """How the tests of a kind ended, with a line for each that was skipped."""

    passed: int
    failed: int
    skipped: list[str]
    took_s: float


def ran(kind: str, arguments: list[str]) -> tuple[int, Counts]:
    """Run the tests of a kind."""
    chosen, workers = KINDS[kind]
    if not any(Path(word.partition("::")[0]).exists() for word in arguments):
        arguments = [*arguments, *files_of(kind)]
    print(f"\n{kind}: {workers} at a time", flush=True)
    command = [sys.executable, "-m", "pytest", "-m", chosen, *arguments]
    if workers > 1:
        command += ["-n", str(workers), "--dist", "loadfile", "--no-loadscope-reorder"]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        began_s = time.monotonic()
        status = subprocess.run([*command, f"--junitxml={report}"], check=False).returncode
        took_s = time.monotonic() - began_s
        cases = list(ET.parse(report).iter("testcase")) if report.exists() else []
    failed = sum(c.find("failure") is not None or c.find("error") is not None for c in cases)
    skipped = [f"{c.get('classname')}::{c.get('name')}: {_why(c)}" for c in cases if _why(c)]
    passed = len(cases) - failed - len(skipped)
    return 0 if status == NOTHING_COLLECTED else status, Counts(passed, failed, skipped, took_s)


def files_of(kind: str) -> list[str]:
    """The files with tests of a kind, told by their text: to import all of them takes long."""
    paths = sorted(Path("tests").rglob("test_*.py"))
    return [str(path) for path in paths if kinds.names(path, kind)]


def _why(case: ET.Element) -> str:
    skipped = case.find("skipped")
    return "" if skipped is None else skipped.get("message", "").removeprefix("Skipped: ") or "?"


def speed() -> str:
    """How fast this machine is: a fixed piece of numpy and a fixed compilation, in seconds."""
    began_s = time.perf_counter()
    values = np.random.default_rng(1).standard_normal((300, 300))
    for _ in range(5):
        np.linalg.svd(values)
    numpy_s = time.perf_counter() - began_s

    def kernel(x: np.ndarray) -> float:
        total = 0.0
        for i in range(x.size):
            total += np.sin(x[i]) * np.exp(-x[i])
        return total

    began_s = time.perf_counter()
    numba.njit(kernel)(values.ravel())
    compiled_s = time.perf_counter() - began_s
    return f"{CORES} cores; numpy {numpy_s:.2f} s, compilation {compiled_s:.2f} s"


def compile_kernels() -> None:
    """Compile what most tests need, once for all workers."""
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        rows = (f"{0.01 * i:.2f},{4e-4 * i:.5f},{0.5 * (i < 40)}" for i in range(60))
        slide = Path(folder) / "slide.csv"
        slide.write_text("\n".join(["time_s,position_m,normal_force_n", *rows]), encoding="utf-8")
        haptic(["demo", "--trace", str(slide), "--out", folder])
    print(f"kernels are there after {time.monotonic() - began_s:.0f} s", flush=True)


def main(arguments: list[str]) -> int:
    wanted = list(KINDS)
    if "--quick" in arguments:
        arguments.remove("--quick")
        wanted = wanted[:1]
    print(f"this machine: {speed()}", flush=True)
    compile_kernels()
    os.sync()  # what was just installed: a recording that forces its ticks to disk waits for all
    worst, results = 0, {}
    for kind in wanted:
        status, results[kind] = ran(kind, arguments)
        worst = max(worst, status)
    print()
    for kind, counts in results.items():
        print(
            f"{kind:9} {counts.passed:6} passed, {counts.failed} failed,"
            f" {len(counts.skipped)} skipped in {counts.took_s:.0f} s"
        )
    skipped = [line for counts in results.values() for line in counts.skipped]
    print(*(f"skipped {line}" for line in skipped), sep="\n")
    passed, failed = (sum(getattr(c, n) for c in results.values()) for n in ("passed", "failed"))
    print(f"tests: {passed} passed, {failed} failed, {len(skipped)} skipped")
    return worst


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
