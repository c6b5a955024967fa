"""Instants are kept absolutely; those that are missed are counted and never made up for."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.processes import real_time
from haptic_driver.processes.real_time import Metronome
from tests.clock import ManualClock


def metronome(clock, number=0):
    return Metronome(0.5, number, clock=clock, sleep_until=clock.sleep_until)


def test_a_late_instant_is_served_at_once_with_its_lateness():
    clock = ManualClock(100.0)
    beat = metronome(clock)
    beat.wait()
    clock.now_s += 0.75  # into the interval after the next instant
    due = beat.wait()
    assert (due.number, due.missed) == (2, 0)
    assert due.lateness_s == pytest.approx(0.25)


@given(st.lists(st.floats(0.0, 3.0), max_size=50))
def test_every_instant_is_served_once_or_missed_once(work_s):
    clock = ManualClock(100.0)
    beat = metronome(clock)
    number = 0
    for work in work_s:
        due = beat.wait()
        assert due.number == number + 1 + due.missed
        assert due.due_s <= clock.now_s < due.due_s + 0.5 + 1e-9
        number = due.number
        clock.now_s += work


def test_an_instant_is_rehearsed_while_awake_before_it_and_never_late():
    clock = ManualClock(100.0)
    beat = Metronome(1e-3, spin_s=real_time.SPIN_S, clock=clock, sleep_until=clock.sleep_until)
    rehearsed = []

    def rehearse(due):
        rehearsed.append((due, clock.now_s))
        clock.now_s += 40e-6

    def spin():  # the clock goes on while nobody sleeps
        clock.now_s += 1e-6
        return clock.now_s

    beat._clock = spin
    due = beat.wait(rehearse)
    assert [coming.number for coming, _ in rehearsed] == [due.number] * len(rehearsed)
    assert len(rehearsed) == 4
    assert all(begun_s < due.due_s - real_time.REHEARSAL_S for _, begun_s in rehearsed)
    assert 0.0 <= due.lateness_s < 2e-6
    clock.now_s += 1.2e-3
    late = beat.wait(rehearse)
    assert late.lateness_s > 0.0
    clock.now_s = late.due_s + 1e-3 - 100e-6
    assert beat.wait(rehearse).lateness_s >= 0.0
    assert len(rehearsed) == 4, "too late for one that has everything to fetch"


def test_sleep_until_never_returns_early():
    for pause_s in (0.003, 0.0, -1.0):
        until_s = time.monotonic() + pause_s
        real_time.sleep_until(until_s)
        assert time.monotonic() >= until_s


@pytest.mark.process
def test_precedence_is_taken_where_it_may_be_and_never_given_away():
    code = (
        "import os; from haptic_driver.processes import real_time;"
        " print(real_time.take_precedence(), os.nice(0))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    granted, niceness = run.stdout.split()
    before = os.getpriority(os.PRIO_PROCESS, 0)
    assert int(niceness) == (min(-10, before) if granted == "True" else before)


@pytest.mark.process
@pytest.mark.skipif(
    not Path("/proc/self/autogroup").exists(), reason="this kernel does not group sessions"
)
def test_a_service_takes_precedence_over_other_sessions():
    """Niceness counts within a session alone where the kernel shares a processor among sessions
    first.
    """
    code = (
        "from haptic_driver.processes import real_time; print(real_time.take_precedence());"
        "print(open('/proc/self/autogroup').read())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        start_new_session=True,
    )
    granted, group = run.stdout.split(maxsplit=1)
    assert granted == "False" or group.strip().endswith("nice -10")


def test_a_machine_that_allows_no_precedence_is_no_failure(monkeypatch):
    def refuse(*arguments):
        raise PermissionError

    monkeypatch.setattr(os, "setpriority", refuse)
    monkeypatch.setattr(
        sys, "setswitchinterval", lambda interval_s: None
    )  # of this process, for the tests to come
    assert real_time.take_precedence() is False


URGENT = """
import os, subprocess, sys
from haptic_driver.processes.real_time import go_first
from haptic_driver.processes.started import start_thread
ask = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
def tell():
    itself = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    print(itself, subprocess.run(ask, capture_output=True, text=True).stdout.strip())
print(go_first())
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
for name in ("bring_out", "off", "api"):
    start_thread(name, tell).join()
"""


@pytest.mark.process
def test_what_keeps_output_alive_goes_first_and_nothing_that_it_starts():
    """Beside a load of 5 on 2 processors the pump was kept waiting for 0.1 s five times a second,
    and the rig tripped for want of a refresh.
    """
    run = subprocess.run([sys.executable, "-c", URGENT], capture_output=True, text=True, check=True)
    granted, *policies = run.stdout.splitlines()
    if granted != "True":
        pytest.skip("this machine grants no real-time scheduling")
    first, ordinary = os.SCHED_FIFO, os.SCHED_OTHER
    assert policies == [f"{first} {ordinary}"] * 2 + [f"{ordinary} {ordinary}"]


SEARCHED = """
import gc
from haptic_driver.cli.main import run
from haptic_driver.processes.real_time import settle_memory
def command():
    settle_memory()
    most = 0
    def count(phase, info):
        nonlocal most
        if phase == "start":
            most = max(most, sum(len(gc.get_objects(g)) for g in range(info["generation"] + 1)))
    gc.callbacks.append(count)
    for _ in range(100_000):  # as connections and requests come and go
        cycle = []
        cycle.append(cycle)
    print(most)
    raise SystemExit
run(command)
"""


@pytest.mark.process
def test_a_search_for_garbage_stops_the_daemons_threads_for_a_short_time():
    """The command line searches after 50,000 objects, so that it starts sooner. A daemon kept that,
    and each search stopped its threads for up to 38 ms.
    """
    run = subprocess.run(
        [sys.executable, "-c", SEARCHED, "models"], capture_output=True, text=True, check=True
    )
    assert int(run.stdout) < 20_000  # 700 new ones, or ten times as many, and what was kept


CHILD = """
import os
from haptic_driver.processes.child import Child
os.nice(3)
child = Child("loader", "json.tool", ["/dev/stdin"])
print(os.getsid(child.pid) == os.getsid(0), os.getpgid(child.pid) == child.pid)
print(os.getpriority(os.PRIO_PROCESS, child.pid) - os.getpriority(os.PRIO_PROCESS, 0))
child.kill()
"""
GIVING_WAY = """
import json, os, sys
from haptic_driver.processes import real_time
from haptic_driver.processes.child import Child
if sys.argv[1:] == ["child"]:
    real_time.give_way()
    print(json.dumps([os.getsid(0) == os.getpid(), os.getpriority(os.PRIO_PROCESS, 0)]), flush=True)
    sys.stdin.read()
else:
    real_time.take_precedence()
    child = Child("loader", "giving_way", ["child"])
    print(child.ready(60.0))
    child.stop()
"""


@pytest.mark.process
def test_a_child_weighs_what_its_parent_weighs_and_is_not_interrupted_with_it():
    """Children had the share of any session: a kill beside 4 busy loops took 12 s to recover from,
    and 8 s since.

    Until they had their weight their start kept control waiting, which waits for the new program to
    begin.
    """
    run = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["True", "True", "0"]


@pytest.mark.process
def test_who_gives_way_has_a_session_of_its_own(tmp_path):
    """With less than the share of any session an observer that gives way starved, and outlived
    control by minutes.
    """
    (tmp_path / "giving_way.py").write_text(GIVING_WAY)
    run = subprocess.run(
        [sys.executable, "-m", "giving_way"],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(["", *sys.path])},
    )
    assert run.stdout.split() == ["[True,", "19]"]


@pytest.mark.process
def test_a_real_time_process_that_never_pauses_is_killed_by_the_kernel():
    """On that priority nobody else would get a turn to stop it."""
    runs_away = """
from haptic_driver.processes import real_time
print(real_time.enter().scheduled, flush=True)
while True:
    pass
"""
    process = subprocess.Popen([sys.executable, "-c", runs_away], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        if process.stdout.readline() != "True\n":
            pytest.skip("this machine grants no real-time scheduling")
        assert process.wait(60.0) < 0
    finally:
        process.kill()
        process.stdout.close()
