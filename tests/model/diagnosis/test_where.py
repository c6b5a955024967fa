"""Places of disagreement in touches whose attraction fades, which the model does not know."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from model.diagnosis.audit import audited
from model.diagnosis.data import Measurements
from model.diagnosis.setting import fitted
from model.diagnosis.space import Predictor
from model.diagnosis.where import disagreement
from tests.fingers import FINGER

FREQUENCIES_HZ, VOLTAGES_V = (1.0, 10.0, 1e3, 1e4), (75.0, 100.0, 125.0, 150.0)
TIMES_S = (1.0, 1.5, 2.0, 2.65)
FADING_PER_S, OWN_PER_S = 0.06, 0.05  # at the lowest frequency; of each setting, either way
TRIAL_STD, ROW_STD, LOAD_STD, TOO_LOW = 0.1, 0.03, 0.08, 0.4
REPEATS, SESSIONS = 4, 2


def fading(seed: int) -> Measurements:
    """Touches read four times each, whose friction fades at the lowest frequency.

    All repeats of a setting also drift alike. At the highest frequency friction is too low by
    exp(-0.4) throughout, as one setting more or less may be.
    """
    chance, rows, factor = np.random.default_rng(seed), [], []
    for session, frequency_hz, voltage_v in product(range(SESSIONS), FREQUENCIES_HZ, VOLTAGES_V):
        per_s = OWN_PER_S * chance.standard_normal()
        per_s += FADING_PER_S if frequency_hz == FREQUENCIES_HZ[0] else 0.0
        low = TOO_LOW if frequency_hz == FREQUENCIES_HZ[-1] else 0.0
        for _ in range(REPEATS):
            load_n = 0.5 * np.exp(LOAD_STD * chance.standard_normal())
            gain = TRIAL_STD * chance.standard_normal()
            for time_s in TIMES_S:
                rows.append((frequency_hz, voltage_v, load_n, time_s, session))
                noise = ROW_STD * chance.standard_normal()
                factor.append(gain - per_s * (time_s - TIMES_S[0]) - low + noise)
    *conditions, number = np.array(rows).T
    names = ("frequency_hz", "voltage_v", "normal_force_n", "time_s")
    columns = dict(zip(names, conditions, strict=True)) | {"cof": np.ones(len(rows))}
    data = Measurements(columns, number.astype(np.intp), ("1", "2"), None, str(seed))
    predictor = Predictor(FINGER, data)
    known = predictor.predicted((), np.zeros((1, len(predictor.free))))[0]
    columns["cof"] = np.exp(known + np.array(factor))
    return data


@pytest.mark.parametrize("seed", range(3))
def test_what_fades_in_each_touch_is_the_first_place(seed):
    """Its rows are compared with others of the same touch, whose gain they share.

    So 12 % in 2 s disagree more than 40 % of a frequency that the touches' gains may hide.
    """
    data = fading(seed)
    audit = audited(FINGER, data)
    setting = fitted(FINGER, audit._replace(kinds=audit.kinds[:1]), lambda _: None)
    base = setting.base
    found = disagreement(setting.data, setting.problem.noise, base.around, base.bent, seed)
    first = found.regions[0]
    assert first.axes == ("frequency_hz", "time_s")
    assert first.high[0] == FREQUENCIES_HZ[0]
    assert found.alarm
