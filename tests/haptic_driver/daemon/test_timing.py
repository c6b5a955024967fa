"""What is said of ticks: shares, gaps, causes, and what to do."""

import numpy as np
import pytest

from haptic_driver.daemon import timing
from haptic_driver.daemon.timing import advice, timing_of
from haptic_driver.processes.samples import SAMPLE
from tests.haptic_driver.daemon.ticks import made_tick

PERIOD_S = 0.001


def ticks(*numbers, **fields):
    """Ticks in time, but for those with fields of their own."""
    return np.array([made_tick(n, **fields.get(f"t{n}", {})) for n in numbers], SAMPLE)


def test_instants_without_a_tick_are_not_in_time_and_each_is_counted():
    found = timing_of(ticks(*range(90), *range(95, 100)), PERIOD_S)
    assert (found.in_time, found.missed) == (0.95, 5)
    assert found.last_cause == "tick 95: render was woken 5.0 ms late, 5 instants missed"


def test_a_tick_that_computes_too_long_is_the_cause_of_the_gap_after_it():
    found = timing_of(ticks(1, 2, 5, 6, t2={"compute_s": 0.0027}), PERIOD_S)
    assert found.last_cause == "tick 2: took 2.7 ms to compute, 2 instants missed"


def test_the_last_cause_is_the_newest_and_only_the_last_hundred_count():
    late = {"lateness_s": 0.0021}
    found = timing_of(ticks(*range(300), t0=late, t150=late, t199=late, t250=late), PERIOD_S)
    assert found.in_time == 0.99
    assert found.last_cause == "tick 250: render was woken 2.1 ms late"


def test_lateness_is_counted_by_bin():
    late = {"lateness_s": 0.0021}
    found = timing_of(
        ticks(*range(10), t3=late, t4={"lateness_s": -1e-6}, t9={"lateness_s": 3.0}), PERIOD_S
    )
    assert dict(zip(found.lateness_edges_s, found.lateness_counts, strict=True)) == {
        0.0: 8,
        1e-4: 0,
        2e-4: 0,
        5e-4: 0,
        1e-3: 0,
        2e-3: 1,
        5e-3: 0,
        1e-2: 0,
        1e-1: 1,
    }


@pytest.mark.parametrize(
    ("load", "governor", "niceness", "real_time", "said"),
    [
        (
            16.2,
            "powersave",
            0,
            False,
            (
                "end other programs (load 16 on 2 processors); set the processors' governor to"
                " performance (it is powersave); allow a niceness of -10 (LimitNICE); allow"
                " real-time scheduling (LimitRTPRIO)"
            ),
        ),
        (
            0.5,
            "performance",
            -10,
            True,
            "look for what else the machine does (virtual machine, interrupts, power saving)",
        ),
        (0.5, None, -10, False, "allow real-time scheduling (LimitRTPRIO)"),
    ],
)
def test_what_to_do_names_what_is_not_as_it_should_be(
    monkeypatch, tmp_path, load, governor, niceness, real_time, said
):
    monkeypatch.setattr(timing.os, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(timing.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(timing.os, "getpriority", lambda *_: niceness)
    monkeypatch.setattr(timing, "GOVERNOR", tmp_path / "governor")
    if governor is not None:
        (tmp_path / "governor").write_text(f"{governor}\n")
    assert advice(real_time) == said
