"""How well the daemon renders now: fidelity and latency of the newest ticks.

The observer's process looks, so that neither render nor control waits for it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.messages import RenderedFidelity
from haptic_driver.fidelity.lag import Latency, latency_of
from haptic_driver.fidelity.measure import Fidelity
from haptic_driver.fidelity.perception import Perception
from haptic_driver.fidelity.said import said
from haptic_driver.fidelity.samples import fidelity_of_samples, tick_s
from haptic_driver.fidelity.sliding import AFTER_TOUCH_S, since_touch_s, sliding
from haptic_driver.processes.shared_memory import SharedState

PERIOD_S = 1.0  # between looks
MOST_TICKS = 10_000  # 10 s, of the 16 s that the ring holds
# A latency that is so far from the budget, and so well known, is a fault of the rig's file.
FAR_S = 0.010
SURE_S = 0.003
# In half a second at one speed linen fitted best at the next thread, 41 ms later.
LEAST_SLIDING_S = 2.0
NOT_YET = Latency(None, None, None, [], "nobody has looked yet")
NOTHING_ASKED = Latency(None, None, None, [], "nothing is asked for")


@dataclass(frozen=True)
class JudgeSettings:
    """See `fidelity_of` for these."""

    perception: Perception
    reach_hz: float
    noise_n: float


class Judged(NamedTuple):
    """What was found in the newest ticks of arming `arming`; `fidelity` is None without sliding.

    `latency` is the lag of felt behind expected friction, which are aligned by the rig's budget:
    so much differs the latency from that.
    """

    arming: int = 0
    fidelity: RenderedFidelity | None = None
    latency: Latency = NOT_YET


class MeasuredLatency(NamedTuple):
    """Time from where the finger is to friction that belongs there, measured and by the budget.

    `measured_s` and its standard error are None where they are unknown; `why` says why.
    """

    measured_s: float | None
    error_s: float | None
    budget_s: float
    why: str

    @property
    def is_far_off(self) -> bool:
        """Whether it is surely another than that of the budget."""
        if self.measured_s is None or self.error_s is None:
            return False
        return abs(self.measured_s - self.budget_s) > FAR_S and self.error_s < SURE_S


def measured_latency(found: Latency, budget_s: float) -> MeasuredLatency:
    """The whole latency, of a lag behind what the budget expects."""
    measured_s = None if found.lag_s is None else budget_s + found.lag_s
    return MeasuredLatency(measured_s, found.error_s, budget_s, found.why)


class Judge:
    """Looks at the newest ticks of the present target, those of 10 s at most.

    Once the output is off, what was found last stands.
    """

    def __init__(self, settings: JudgeSettings, shared: SharedState) -> None:
        self._settings = settings
        self._shared = shared
        self._target = (0, 0)
        self._begins = 0  # in the ring
        self._found: Judged | None = None  # of this target

    def look(self) -> Judged:
        """What there is to say now."""
        order = self._shared.order.read()
        if (order.arming, order.target) != self._target:
            self._target = (order.arming, order.target)
            self._begins = self._shared.ring.position
            self._found = None
        if order.rendering or self._found is None:
            self._found = self._judged(order.arming)
        return self._found

    def _judged(self, arming: int) -> Judged:
        ring = self._shared.ring
        samples = ring.newest(min(ring.position - self._begins, MOST_TICKS))
        if not np.isfinite(samples["target_cof"]).any():
            return Judged(arming, None, NOTHING_ASKED)
        settings = self._settings
        fidelity = fidelity_of_samples(
            samples, settings.perception, settings.reach_hz, settings.noise_n
        )
        return Judged(arming, told(samples, fidelity), latency_in(samples))


def latency_in(samples: NDArray[np.void]) -> Latency:
    """The lag of felt behind expected friction in samples [n] of dtype SAMPLE."""
    judged = sliding(samples) & (since_touch_s(samples) >= AFTER_TOUCH_S)
    step_s = tick_s(samples)
    if step_s * np.count_nonzero(judged) < LEAST_SLIDING_S:
        return Latency(None, None, None, [], f"less than {LEAST_SLIDING_S:g} s of sliding")
    expected = np.where(judged, samples["expected_cof"], np.nan)
    felt = np.where(judged, samples["measured_cof"], np.nan)
    return latency_of(expected, felt, step_s)


def told(samples: NDArray[np.void], fidelity: Fidelity) -> RenderedFidelity | None:
    """What the status says of it; None without sliding."""
    if fidelity.sliding_time_s == 0.0:
        return None
    known = asdict(fidelity)
    headline = {name: known[name] for name in RenderedFidelity.model_fields if name in known}
    return RenderedFidelity(
        first_tick=int(samples["tick"][0]),
        last_tick=int(samples["tick"][-1]),
        said=said(fidelity),
        **headline,
    )
