"""What the status says was asked for."""

from types import SimpleNamespace

import numpy as np
import pytest

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.targets import Targets
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import NO_OUTPUT
from haptic_driver.render.texture import Uniform
from tests.clock import ManualClock


@pytest.fixture
def targets(shared):
    orders, clock = SimpleNamespace(order=SimpleNamespace(target=2)), ManualClock(0.0)
    reachable, screen_m = (lambda load_n: (0.5, 1.3)), (0.1, 0.06)
    return Targets(shared, orders, EventLog(), clock, reachable, Loader(), screen_m)


def test_a_target_that_render_does_not_take_up_is_told(targets):
    looks = []
    with pytest.raises(RefusedError) as refused:
        targets.await_taken(lambda output: looks.append(targets._clock.sleep(0.1)))
    assert refused.value.code == "render_stalls"
    assert len(looks) == 6


def samples(target_cof, measured_cof):
    made = np.zeros(len(target_cof), SAMPLE)
    made["target_cof"], made["measured_cof"] = target_cof, measured_cof
    return made


def test_of_a_texture_the_target_is_the_mean_beside_what_was_measured(targets):
    output = NO_OUTPUT._replace(target=2, target_cof=0.9)
    lifted = samples([0.6, 0.7, 0.8, np.nan], [0.61, 0.7, np.nan, 0.8])
    assert targets.asked_cof(output, lifted) == pytest.approx(0.65)
    assert targets.asked_cof(output, lifted[2:]) == 0.9  # what is asked now
    assert targets.asked_cof(output._replace(target_cof=np.nan), lifted[2:]) is None
    assert targets.asked_cof(output._replace(target=1), lifted) is None  # not taken up yet


def test_one_friction_is_known_before_render_has_taken_it_up(targets):
    targets.target = Uniform(0.7)
    assert targets.asked_cof(NO_OUTPUT, samples([0.6], [0.6])) == 0.7
