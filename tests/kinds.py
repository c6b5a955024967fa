"""Three kinds of tests, by what they need; docs/house.md says how to write one of each.

An unmarked test is pure: it starts no process, and time passes in it as it says. One marked
`process` starts some and asserts no time. One marked `realtime` claims something about time. It is
repeated where it failed beside an empty loop that was late too, and then skipped with that figure.
"""

from __future__ import annotations

import re
import sys
import time
from functools import cache
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

from tests.machine import EmptyLoop

MARKED = ("process", "realtime", "soak")
OF_ALL = re.compile(rf"^pytestmark = .*\bmark\.({'|'.join(MARKED)})\b", re.MULTILINE)
STARTS = ("subprocess.Popen", "os.posix_spawn", "os.fork", "os.forkpty")
# Started by the standard library where somebody looks for a library, or asks what machine this is.
LOOKS = ("ldconfig", "gcc", "cc", "ld", "objdump", "uname")

_started: list[str] = []


def _note_starts(event: str, arguments: tuple, starts: tuple = STARTS) -> None:
    # `starts` is there too when the interpreter has taken its modules apart
    # a fork has no arguments
    if event in starts and not "".join(map(str, arguments[:1])).endswith(LOOKS):
        _started.append(str(arguments[:2]))


sys.addaudithook(_note_starts)


@cache
def names(path: Path, kind: str) -> bool:
    """Whether a file names a kind, which tells where its tests are without importing all; it is
    pure where no kind stands for the whole file.
    """
    text = path.read_text(encoding="utf-8")
    return not OF_ALL.search(text) if kind == "pure" else f"mark.{kind}" in text


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        for kind in filter(item.get_closest_marker, MARKED):
            if not names(item.path, kind):
                raise pytest.UsageError(f"{item.path}: its text has to name pytest.mark.{kind}")
    # Modules that share a daemon stand together; who starts one of his own comes before.
    items.sort(key=lambda item: getattr(item.module, "DAEMON_RIG", ""))


def is_pure(item: pytest.Item) -> bool:
    return not any(item.get_closest_marker(name) for name in MARKED)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item):
    yield from _no_process(item)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item):
    yield from _no_process(item)


def _no_process(item: pytest.Item):
    before = len(_started)
    result = yield
    if is_pure(item) and len(_started) > before:
        pytest.fail(f"mark it process or realtime: it started {_started[before]}")
    return result


class Beside:
    """The empty loop beside the tests of real time, there from the first of them on."""

    def __init__(self) -> None:
        self._loop: EmptyLoop | None = None

    def loop(self) -> EmptyLoop:
        if self._loop is None:
            self._loop = EmptyLoop()
        return self._loop

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None):
        """Run it; again where the machine was late; skip it where the machine was late again."""
        if not item.get_closest_marker("realtime"):
            return None
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        reports, late_s = self._tried(item, nextitem)
        if late_s:
            # What a late machine left in a fixture is made anew.
            item.session._setupstate.teardown_exact(None)
            item._initrequest()
            reports, late_s = self._tried(item, nextitem)
        if late_s:
            reports = [_skipped(report, late_s) for report in reports]
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _tried(self, item: pytest.Item, nextitem: pytest.Item | None):
        """The reports of a try; and of one that failed, how late the loop beside it was."""
        loop = self.loop()
        began_s = time.monotonic()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        if any(report.failed for report in reports):
            return reports, loop.longest_wait_s(began_s)
        return reports, 0.0

    def pytest_unconfigure(self) -> None:
        if self._loop is not None:
            self._loop.close()


def _skipped(report: pytest.TestReport, late_s: float) -> pytest.TestReport:
    if report.failed:
        report.outcome = "skipped"
        path, line, _ = report.location
        why = f"the machine kept an empty loop beside it waiting for {late_s:.2f} s"
        said = str(report.longrepr).strip().splitlines()
        report.longrepr = (path, line or 0, f"Skipped: {why}; it failed with: {said[-1]}")
    return report
