"""`haptic set 0.6137` is followed from the command to the output: which files hand it on, and where
its range is checked.

Every call is looked at while it happens: in the command, the API and control of one process, and in
the daemon's own render and output pump by a simulated clock.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType

import pytest

import haptic_driver
from haptic_driver.cli.main import main
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import SteppedDaemon
from haptic_driver.daemon.web.server import serve
from haptic_driver.render.texture import Uniform
from haptic_driver.simulation.rig import SimulatedRig
from tests.waiting import until

pytestmark = pytest.mark.process

DAEMON_RIG = "simulated"
COF = 0.6137
SOURCES = Path(haptic_driver.__file__).parent
HOUSE = Path(__file__).resolve().parents[3] / "docs" / "house.md"
MOST_FILES = 9
MOST_FIELDS = 20
# Where a friction is in another's hands. The function called there, and what it belongs to.
SENT = "HTTPConnection.request"
ANSWERED = "_route.<locals>.answer"
WRITTEN = "Store.write"
TICKED = "tick"
COMMANDED = "SetpointActuator._set_point"
MILESTONES = {SENT, ANSWERED, WRITTEN, TICKED, COMMANDED}
WORDS_OF_ALL = "cli/main.py"  # splits every command line
LOOP = "daemon/stepped.py"  # in which render and pump take turns here


def carries(thing: object, depth: int = 3) -> bool:
    """Whether the friction is in it, as a number or in words."""
    if isinstance(thing, float):
        return thing == COF
    if isinstance(thing, str | bytes):
        return str(COF) in (thing if isinstance(thing, str) else thing.decode("latin-1"))
    if isinstance(thing, dict):
        inner = list(thing.values())
    elif isinstance(thing, tuple | list):
        inner = list(thing)
    else:
        inner = list(getattr(thing, "__dict__", {}).values())
    return depth > 0 and len(inner) < MOST_FIELDS and any(carries(x, depth - 1) for x in inner)


def given(frame: FrameType) -> Iterator[object]:
    """The arguments of a call."""
    code = frame.f_code
    count = code.co_argcount + code.co_kwonlyargcount + bool(code.co_flags & 4)
    for name in code.co_varnames[: count + bool(code.co_flags & 8)]:
        if name != "self" and name in frame.f_locals:
            yield frame.f_locals[name]


class Followed:
    """Calls while `following`: what was called, and by milestone the files of those on the stack
    who have the friction.
    """

    def __init__(self) -> None:
        self.following = False
        self.called: list[str] = []
        self.way: dict[str, set[str]] = {}

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if not self.following or event != "call":
            return
        name = frame.f_code.co_qualname
        self.called.append(name)
        if name in MILESTONES and (name in (TICKED, COMMANDED) or any(map(carries, given(frame)))):
            files, caller = self.way.setdefault(name, set()), frame
            while caller is not None:
                path = Path(caller.f_code.co_filename)
                is_on_it = name in (TICKED, COMMANDED) or any(map(carries, given(caller)))
                if path.is_relative_to(SOURCES) and is_on_it:
                    files.add(path.relative_to(SOURCES).as_posix())
                caller = caller.f_back

    @contextmanager
    def here(self) -> Iterator[Followed]:
        """Follow the block's calls, in all threads that were started meanwhile."""
        self.following, before = True, sys.getprofile()
        sys.setprofile(self)
        try:
            yield self
        finally:
            sys.setprofile(before)
            self.following = False


@pytest.fixture(scope="module")
def followed():
    return Followed()


@pytest.fixture(scope="module")
def socket(followed, running, tmp_path_factory):
    """A daemon that is armed, with every thread looked at that answers from there."""
    path = tmp_path_factory.mktemp("verb") / "d.sock"
    before = threading.getprofile()
    threading.setprofile(followed)
    try:
        with closing(Place(path)) as place, serve(running, place):
            until(lambda: not running.supervisor.missing and not running.supervisor.silent())
            lease = running.arm(60.0)
            path.with_name("d.sock.lease").write_text(lease.token)
            yield path
            running.disarm()
    finally:
        threading.setprofile(before)


@pytest.fixture(scope="module")
def way(followed, socket, rig_config, surface_file, touch):
    """The files that a friction goes through, by milestone."""
    with followed.here():
        assert main(["set", str(COF), "--socket", str(socket)]) == 0
    assert len(followed.called) > len(MILESTONES)
    with SimulatedRig(rig_config, touch) as bench:
        stepped = SteppedDaemon(render_settings(rig_config, surface_file), bench, Uniform(COF))
        try:
            stepped.connect()
            with followed.here():
                for tick in range(100):
                    stepped.tick(0.02 + 5e-5 * tick, 0.5, 0.05)
        finally:
            bench.rig.off()
            stepped.close()
    return {name: files - {WORDS_OF_ALL, LOOP} for name, files in followed.way.items()}


def test_each_step_of_the_way_hands_it_on(way):
    assert way == {
        SENT: {"cli/control.py", "client.py"},
        ANSWERED: {"daemon/web/api.py"},
        WRITTEN: {"daemon/verbs.py", "daemon/targets.py", "processes/shared_memory.py"},
        TICKED: {"daemon/render_process.py", "render/tick.py"},
        COMMANDED: {"daemon/output_pump.py", "rig/actuator.py"},
    }


def test_from_the_command_to_the_rig_nine_files_touch_it(way):
    files = set().union(*way.values()) - {"rig/actuator.py"}  # the rig begins there
    assert len(files) <= MOST_FILES
    walk = HOUSE.read_text(encoding="utf-8").partition("## One verb")[2].partition("\n## ")[0]
    named = set(re.findall(r"`([a-z_/]+\.py)`", walk))
    assert files <= named


def test_the_range_is_checked_once_where_it_arrives(socket, followed, capsys):
    """Neither the command nor the client looks at it, and what follows is not asked."""
    followed.called.clear()
    with followed.here():
        assert main(["set", "99", "--socket", str(socket)]) == 2
    assert "99" in capsys.readouterr().err
    assert followed.called.count(SENT) == 1
    assert followed.called.count("_answer_errors.<locals>.invalid") == 1
    assert "Verb.said_json" not in followed.called
