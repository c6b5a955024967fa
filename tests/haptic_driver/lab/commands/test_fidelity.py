"""`haptic fidelity`: the same measure for a recording, a table, and somebody else's two files."""

import numpy as np
import pytest

from haptic_driver.recording.event import Event
from tests.haptic_driver.commands import said_by
from tests.haptic_driver.live.recorded_runs import Part, record, ticks

LAG_S = 0.02


def asked_at(time_s):
    """Of periods that no lag of 100 ms brings back."""
    return 0.6 + 0.1 * np.sin(14.0 * time_s) + 0.05 * np.sin(23.0 * time_s)


def written(path, header, *columns):
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in np.transpose(columns))
    path.write_text(header + rows + "\n")
    return path


def test_a_table_with_names_and_units_of_its_own(haptic, tmp_path):
    time_s = np.arange(0.0, 4.0, 0.002)
    felt = asked_at(time_s - LAG_S)
    file = written(tmp_path / "t.csv", "ms,wanted,mu\n", 1e3 * time_s, asked_at(time_s), felt)
    named = ["time_s=ms:ms", "target_cof=wanted", "measured_cof=mu"]
    done = haptic("fidelity", file, "--json", *[w for n in named for w in ("--column", n)])
    assert done.status == 0
    assert done.said["best_lag_s"] == pytest.approx(LAG_S, abs=1e-3)
    assert done.said["correlation_at_best_lag"] > 0.999
    expected = np.corrcoef(asked_at(time_s), felt)[0, 1]
    assert done.said["correlation"] == pytest.approx(expected, abs=1e-3)


def test_two_files_at_rates_of_their_own_over_the_time_that_both_have(tmp_path):
    felt_s, asked_s = np.arange(1.0, 5.0, 0.0021), np.arange(0.0, 4.0, 0.017)
    felt = written(tmp_path / "felt.csv", "", felt_s, 2.0 * asked_at(felt_s - LAG_S))
    asked = written(tmp_path / "asked.csv", "time,friction\n", asked_s, asked_at(asked_s))
    said = said_by("fidelity", felt, "--asked", asked)
    assert said["sliding_time_s"] == pytest.approx(3.0, abs=0.05)
    assert said["best_lag_s"] == pytest.approx(LAG_S, abs=2e-3)
    assert said["relative_error_rms"] == pytest.approx(1.0, abs=0.15)


def test_nothing_is_made_up_in_a_gap(haptic, tmp_path):
    time_s = np.arange(0.0, 4.0, 0.002)
    kept = (time_s < 1.0) | (time_s > 3.0)
    columns = time_s[kept], asked_at(time_s)[kept], asked_at(time_s)[kept]
    file = written(tmp_path / "t.csv", "time_s,target_cof,measured_cof\n", *columns)
    said = haptic("fidelity", file, "--json").said
    assert said["sliding_time_s"] == pytest.approx(2.0, abs=0.05)
    assert said["share_within_5_percent"] == 1.0


def test_a_recording_has_all_that_it_needs(haptic, rng, tmp_path):
    made = ticks([Part(2.0)], lambda *_: 0.306, rng, wobble=0.0, noise_n=0.0)
    made["lateral_force_n"], made["measured_cof"] = 0.306, 0.612  # from the first tick on
    made["target_cof"], made["reachable"] = 0.6, 1
    played = {"wool.toml": 3.0, "linen": 1.0}
    events = [
        Event(number=i, time_s=0.1, kind="texture", message=name, data={"perceptual_gain": gain})
        for i, (name, gain) in enumerate(played.items())
    ]
    record(tmp_path / "run.h5", made, events=events)
    assert "wool.toml was asked for with 3 times" in haptic("fidelity", tmp_path / "run.h5").out
    said = haptic("fidelity", tmp_path / "run.h5", "--json").said
    assert said["perceptual_gain"] == {"wool.toml": 3.0}
    assert said["share_within_5_percent"] == 1.0
    assert said["relative_error_rms"] == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [("1,0.5\n0.5,0.6\n", "go back"), ("1,0.5\n", "no two rows"), ("a,b\nc,d\n", "felt.csv")],
)
def test_what_cannot_be_compared_is_refused(haptic, tmp_path, text, said):
    (tmp_path / "felt.csv").write_text(text)
    done = haptic("fidelity", tmp_path / "felt.csv", "--asked", tmp_path / "felt.csv")
    assert done.status == 2
    assert said in done.err
