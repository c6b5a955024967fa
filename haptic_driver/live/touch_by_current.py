"""What the electrode's current says of a touch where no sensor measures its force: a load, a
finger, and its friction.

The current per volt depends on load, area, skin and gaps; its slow part cannot tell these apart.
But attraction presses the gaps together, and the current rises with them. So the current's response
to a changing voltage shows how strong attraction is beside the load. That ratio is also the rise of
friction. An extended Kalman filter (Jazwinski, Stochastic Processes and Filtering Theory, 1970, ch.
8) holds a few of the finger's numbers against the model's current. Friction without voltage leaves
no trace in the current: it stays the model's.
"""

from __future__ import annotations

from functools import partial
from math import nan
from typing import NamedTuple

import numpy as np

from haptic_driver.render.feedback import FeedbackSettings
from haptic_driver.signals import Array
from haptic_driver.simulation.finger_model import with_hidden
from hw.monitor.contract import ElectrodeReading
from model.conditions import Conditions
from model.description import ModelDescription
from model.effects.skin_hydration import SkinHydration
from model.touch_model import TouchModel

# log load, log gain and phase of the current, wetness, log roughness: their spread, and how long
# they last
SPREAD = np.array([0.35, 0.15, 0.05, 1.0, 0.2])
LASTS_S = np.array([2.0, 120.0, 120.0, 60.0, 120.0])
FARTHEST = 3.0  # spreads from the usual finger
FORM = 0.005  # of the current, 1 sigma: no finger is quite the model's
LEAST_V, QUIET_V = 5.0, 0.01  # below, the current says little of attraction; stands for none
STEP = 1e-2  # of the numerical derivatives
SHAPED = [0, 3, 4]  # of the numbers, those that change friction
LEVEL_STD = FeedbackSettings(0.0).deviation  # of friction without voltage, from finger to finger
TOLD = 0.5  # of what is unknown of the rise beforehand; more teaches nothing


class CurrentTouch(NamedTuple):
    """Load in N, and friction at the voltage of the reading with its standard deviation.

    `tells`: the current has told enough of what attraction makes of friction to learn from it.
    """

    load_n: float
    cof: float
    cof_std: float
    tells: bool


class _Expected(NamedTuple):
    load_n: float
    cof: float
    off_cof: float  # without voltage
    admittance: complex


class TouchByCurrent:
    """The touch as it follows from one reading after another; `load_n`: a finger's usual one,
    `stray_f`: beside the finger.
    """

    def __init__(self, description: ModelDescription, load_n: float, stray_f: float = 0.0) -> None:
        self._own, self._load_n = description.with_values(stray_capacitance_f=stray_f), load_n
        self._off, self._covariance = np.zeros(SPREAD.size), np.diag(SPREAD**2)

    def felt(
        self,
        frequency_hz: float,
        reading: ElectrodeReading,
        elapsed_s: float,
        contact_area_m2: float = nan,
    ) -> CurrentTouch:
        """What is known with one more reading, so long after the last; next to no voltage teaches
        nothing. An area that is NaN is the model's.
        """
        kept = np.exp(-elapsed_s / LASTS_S)
        self._off *= kept
        self._covariance = self._covariance * np.outer(kept, kept) + np.diag(
            (1.0 - kept**2) * SPREAD**2
        )
        voltage_v = abs(reading.voltage_v)
        expected = partial(self._expected, frequency_hz, contact_area_m2)
        if voltage_v < LEAST_V or reading.current_a == 0.0:
            quiet = expected(max(voltage_v, QUIET_V), self._off)
            return CurrentTouch(quiet.load_n, quiet.cof, LEVEL_STD * quiet.off_cof, False)
        moved = self._off + STEP * np.eye(SPREAD.size)[SHAPED]
        told, *beside = (expected(voltage_v, off) for off in (self._off, *moved))
        slope = np.zeros((2, SPREAD.size))
        slope[:, [1, 2]] = np.eye(2)
        ratios = [parts(other.admittance / told.admittance) for other in beside]
        slope[:, SHAPED] = np.transpose(ratios) / STEP
        noise = (reading.current_std_a / abs(reading.current_a)) ** 2 + (
            reading.voltage_std_v / voltage_v
        ) ** 2
        share = slope @ self._covariance @ slope.T + (noise + FORM**2) * np.eye(2)
        gain = np.linalg.solve(share, slope @ self._covariance).T
        missed = parts(reading.current_a / reading.voltage_v / told.admittance)
        missed -= self._off[[1, 2]]
        self._off = np.clip(self._off + gain @ missed, -FARTHEST * SPREAD, FARTHEST * SPREAD)
        self._covariance = self._covariance - gain @ slope @ self._covariance
        rises = np.array([other.cof - told.cof for other in beside]) / STEP
        known = float(np.sqrt(rises @ self._covariance[np.ix_(SHAPED, SHAPED)] @ rises))
        before = float(np.sqrt(rises @ np.diag(SPREAD[SHAPED] ** 2) @ rises))
        felt = expected(voltage_v, self._off)
        std = float(np.hypot(known, LEVEL_STD * felt.off_cof))
        return CurrentTouch(felt.load_n, felt.cof, std, known < TOLD * before)

    def _expected(
        self, frequency_hz: float, contact_area_m2: float, voltage_v: float, off: Array
    ) -> _Expected:
        """What such a finger feels, and its current per volt."""
        log_load, _, _, wetness, log_roughness = map(float, off)
        load_n, own = self._load_n * float(np.exp(log_load)), self._own
        roughness_m = own.parameters["roughness_rms_m"].value * float(np.exp(log_roughness))
        known = own.effect_parameters.get(SkinHydration.name, {}).get("wetness")
        wet = {SkinHydration.name: {"wetness": wetness + (known.value if known else 0.0)}}
        finger = with_hidden(TouchModel(own.with_values(roughness_rms_m=roughness_m)), wet)
        v = np.array([voltage_v, QUIET_V])
        f, n, area_m2 = (np.full(v.size, each) for each in (frequency_hz, load_n, contact_area_m2))
        found = finger.predict(Conditions(f, v, n, contact_area_m2=area_m2))
        admittance = found.electrode_current_a[0] / found.electrode_voltage_v[0]
        cof, off_cof = found.cof.tolist()
        return _Expected(load_n, cof, off_cof, complex(admittance))


def parts(ratio: complex) -> Array:
    """A ratio as logarithm of its amount, and its phase."""
    return np.array([np.log(abs(ratio)), np.angle(ratio)])
