"""Something goes wrong while `haptic measure` presses a finger; 200 random moments are in
`tests/soak/test_loads.py`.
"""

import pytest

from tests.haptic_driver.lab.measuring.load_moments import failed, serving

pytestmark = pytest.mark.timeout(300)
ATTEMPTS = 4


@pytest.mark.parametrize(
    ("what", "moment_s", "said"),
    [
        ("pulled", 1.1, "may still press"),
        ("silent", 1.7, "silent"),
        ("saturated", 2.8, "saturated"),
        ("thrust", 3.3, "its limit 0.75 N"),
        ("ctrl-c", 2.1, "KeyboardInterrupt"),
    ],
)
def test_whatever_fails_the_finger_feels_less_than_the_limit_and_the_output_is_off(
    model, tmp_path, what, moment_s, said
):
    moment = failed(model, tmp_path / "data.csv", what, moment_s)
    assert moment.safe, str(moment)
    assert said in moment.said
    assert moment.highest_n > 0.0, "nothing was pressed"
    if what in ("silent", "saturated", "ctrl-c"):
        assert moment.last_n == 0.0


@pytest.mark.realtime
@pytest.mark.soak
def test_a_killed_process_leaves_the_finger_to_the_watchdog(config, model, tmp_path):
    """Within the first row's stroke. Where the machine is too busy for the rig, the process ends by
    itself, which has to be as safe: then once more.
    """
    with serving(config, model, tmp_path) as served:
        for _ in range(ATTEMPTS):
            moment = served.killed(3.0)
            assert moment.safe, str(moment)
            assert moment.last_n == 0.0
            if not moment.said:
                break
    assert moment.highest_n > 0.05, f"nothing was pressed: {moment}"
