"""How ticks keep their time, in numbers and in words. Statistics warn; they take no output away."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.messages import Timing
from haptic_driver.processes.real_time import NICENESS

IN_TIME_S = 0.002
RECENT_TICKS = 100
ENOUGH = 0.95  # of them in time
EDGES_S = (0.0, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 1e-1)
"""Lower edges of the bins of `Timing.lateness_counts`; the last bin is open."""
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")


def timing_of(samples: NDArray[np.void], period_s: float) -> Timing:
    """Of the newest ticks [n], without gaps in the record. Instants that were missed count as not
    in time.
    """
    recent = samples[-RECENT_TICKS:]
    place = np.searchsorted(EDGES_S, samples["lateness_s"], side="right") - 1
    return Timing(
        in_time=(
            float(np.count_nonzero(recent["lateness_s"] <= IN_TIME_S) / _due(recent))
            if recent.size
            else None
        ),
        missed=_due(samples) - samples.size,
        lateness_edges_s=list(EDGES_S),
        lateness_counts=np.bincount(np.maximum(place, 0), minlength=len(EDGES_S)).tolist(),
        last_cause=_last_cause(samples, period_s),
    )


def advice(real_time: bool) -> str:
    """What to do about ticks that are late, on this machine."""
    found = []
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    if load > processors:
        found.append(f"end other programs (load {load:.0f} on {processors} processors)")
    with suppress(OSError):
        governor = GOVERNOR.read_text(encoding="ascii").strip()
        if governor != "performance":
            found.append(f"set the processors' governor to performance (it is {governor})")
    if os.getpriority(os.PRIO_PROCESS, 0) > NICENESS:
        found.append(f"allow a niceness of {NICENESS} (LimitNICE)")
    if not real_time:
        found.append("allow real-time scheduling (LimitRTPRIO)")
    return (
        "; ".join(found)
        or "look for what else the machine does (virtual machine, interrupts, power saving)"
    )


def _due(samples: NDArray[np.void]) -> int:
    """Instants from the first to the last."""
    return int(samples["tick"][-1] - samples["tick"][0]) + 1 if samples.size else 0


def _last_cause(samples: NDArray[np.void], period_s: float) -> str | None:
    """What the newest tick that was late, or came after a gap, was late by; None where all were in
    time.
    """
    gap = np.diff(samples["tick"], prepend=samples["tick"][:1]).astype(np.int64)
    late = np.flatnonzero((samples["lateness_s"] > IN_TIME_S) | (gap > 1))
    if not late.size:
        return None
    last = int(late[-1])
    tick, before = samples[last], samples[last - 1]
    missed = f", {gap[last] - 1} instants missed" if gap[last] > 1 else ""
    if gap[last] > 1 and before["compute_s"] > period_s:
        return f"tick {before['tick']}: took {1e3 * before['compute_s']:.1f} ms to compute{missed}"
    late_s = tick["lateness_s"] + max(gap[last] - 1, 0) * period_s
    return f"tick {tick['tick']}: render was woken {1e3 * late_s:.1f} ms late{missed}"
