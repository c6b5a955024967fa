"""Staircases by hand, QUEST+ against Bayes' rule written out, and optimisers of others in Python
and over HTTP.
"""

import json
import re
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlparse

import numpy as np
import pytest

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.psychophysics.description import (
    Comparison,
    Condition,
    Outside,
    QuestPlus,
    Range,
    Staircase,
)
from haptic_driver.lab.psychophysics.methods import StaircaseMethod, converges_at
from haptic_driver.lab.psychophysics.outside import OutsideMethod
from haptic_driver.lab.psychophysics.quest_plus import QuestPlusMethod
from tests.haptic_driver.lab.refusal import refused

ABOUT = {"experiment": "made", "condition": "a"}


def climbed(settings, answers):
    """The levels that a staircase stands at, before each answer and after the last."""
    staircase = StaircaseMethod(settings)
    levels = []
    for answer in answers:
        levels.append(staircase.suggest())
        staircase.report(levels[-1], answer == "+")
    return [*levels, staircase.suggest()], staircase


def test_two_down_one_up_by_hand():
    settings = Staircase(
        kind="staircase",
        start=10.0,
        steps=[4.0, 2.0, 1.0],
        scale="linear",
        low=1.0,
        high=10.0,
        reversals=3,
        averaged=2,
    )
    levels, staircase = climbed(settings, "++++-+-")
    #                          down to 6, down to 2, up (1st reversal) by 2, no step yet, up again
    assert levels == [10.0, 10.0, 6.0, 6.0, 2.0, 4.0, 4.0, 6.0]
    assert staircase.reversals == [2.0]
    levels, staircase = climbed(settings, "++-++-")
    # steps 4, 2, 1; over after three reversals
    assert levels == [10.0, 10.0, 6.0, 8.0, 8.0, 7.0, None]
    assert staircase.reversals == [6.0, 8.0, 7.0]
    assert staircase.estimate == pytest.approx(7.5)


def test_ratios_stay_within_their_limits_and_trials_end_it():
    settings = Staircase(
        kind="staircase", start=0.4, steps=[1.0], low=0.15, high=0.5, down=1, trials=3
    )
    assert climbed(settings, "++-")[0] == [0.4, 0.2, 0.15, None]
    assert climbed(settings, "-")[0] == [0.4, 0.5]


@pytest.mark.parametrize(
    ("up", "down", "share"), [(1, 1, 0.5), (1, 2, 0.7071), (1, 3, 0.7937), (2, 2, None)]
)
def test_where_a_staircase_comes_to_rest(up, down, share):
    """Levitt's table 1."""
    settings = Staircase(
        kind="staircase", start=1.0, steps=[0.1], low=0.1, high=2.0, up=up, down=down
    )
    assert converges_at(settings) == (None if share is None else pytest.approx(share, abs=1e-4))


def test_reversals_at_the_end_of_a_staircase_are_no_threshold():
    """Nothing is felt: it climbs to the top, and luck takes it a step down now and then."""
    rng = np.random.default_rng(3)
    settings = {"start": 0.2, "steps": [0.12], "reversals": 60, "averaged": 40, "trials": 400}
    lost, found = (
        StaircaseMethod(Staircase(kind="staircase", low=0.01, high=high, **settings))
        for high in (0.5, 10.0)
    )
    for staircase, answers in ((lost, lambda level: False), (found, lambda level: level > 0.15)):
        while (level := staircase.suggest()) is not None:
            staircase.report(level, answers(level) or bool(rng.random() < 0.5))
    assert "lie at 0.5, the end of the staircase" in lost.at_end
    assert found.at_end == ""


def test_quest_plus_suggests_what_bayes_rule_written_out_suggests():
    settings = QuestPlus(
        kind="quest_plus",
        levels=Range(low=0.05, high=0.8, count=9),
        thresholds=Range(low=0.05, high=0.5, count=7),
        slopes=[1.5, 3.0],
        lapses=[0.0, 0.05],
        trials=12,
    )
    method = QuestPlusMethod(settings, "weibull", 0.5)
    levels, thresholds = np.geomspace(0.05, 0.8, 9), np.geomspace(0.05, 0.5, 7)
    grid = [(t, s, lapse) for t in thresholds for s in (1.5, 3.0) for lapse in (0.0, 0.05)]
    belief = {functions: 1.0 / len(grid) for functions in grid}

    def positive(x, functions):
        t, s, lapse = functions
        return 1.0 - lapse - (0.5 - lapse) * 2.0 ** -((x / t) ** s)

    def updated(x, answer):
        new = {
            f: p * (positive(x, f) if answer else 1.0 - positive(x, f)) for f, p in belief.items()
        }
        total = sum(new.values())
        return total, {f: p / total for f, p in new.items()}

    def entropy_after(x):
        branches = [updated(x, answer) for answer in (True, False)]
        return sum(
            -share * sum(p * np.log(p) for p in after.values() if p > 0)
            for share, after in branches
        )

    for answer in "++-++-+-+++-":
        entropies = [entropy_after(x) for x in levels]
        level = method.suggest()
        chosen = int(np.argmin(abs(levels - level)))
        assert entropies[chosen] == pytest.approx(min(entropies), abs=1e-9)
        _, belief = updated(level, answer == "+")
        method.report(level, answer == "+")
    assert method.suggest() is None
    mean, std = method.estimate
    assert mean == pytest.approx(sum(p * f[0] for f, p in belief.items()))
    assert std == pytest.approx(np.sqrt(sum(p * (f[0] - mean) ** 2 for f, p in belief.items())))


def test_quest_plus_ends_when_it_is_sure():
    settings = QuestPlus(
        kind="quest_plus",
        levels=Range(low=0.05, high=0.8),
        thresholds=Range(low=0.05, high=0.5),
        trials=400,
        stop_std=0.2,
    )
    method, rng, trials = QuestPlusMethod(settings, "weibull", 0.5), np.random.default_rng(3), 0
    while (level := method.suggest()) is not None:
        method.report(level, bool(rng.random() < 0.5 + 0.5 * (level > 0.2)))
        trials += 1
    assert 5 < trials < 400
    mean, std = method.estimate
    assert std < 0.2 * mean


# --- optimisers of others
# ----------------------------------------------------------------------------------------


class Halving:
    """Somebody's optimiser."""

    def __init__(self, experiment, condition):
        self.said, self.level = [(experiment, condition)], 0.8

    def suggest(self):
        return self.level if len(self.said) < 4 else None

    def report(self, level, positive):
        self.said.append((level, positive))
        self.level = level / 2.0 if positive else level * 1.5


@pytest.fixture
def server():
    """The same behind HTTP; its URL, and what it was told."""
    optimiser = Halving(None, None)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            url = urlparse(self.path)
            assert url.path == "/suggest"
            assert {k: v[0] for k, v in parse_qs(url.query).items()} == ABOUT
            self._answer({"level": optimiser.suggest()})

        def do_POST(self):
            assert self.path == "/report"
            said = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            assert {k: said.pop(k) for k in ABOUT} == ABOUT
            optimiser.report(**said)
            self._answer({})

        def _answer(self, content):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(json.dumps(content).encode())

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield f"http://127.0.0.1:{http.server_port}", optimiser
        http.shutdown()
        thread.join()


def asked(method, answers):
    levels = []
    for answer in answers:
        levels.append(method.suggest())
        assert method.suggest() == levels[-1]  # asked once, the same until it is reported
        method.report(levels[-1], answer == "+")
    return [*levels, method.suggest()]


def test_an_optimiser_over_http_is_asked_and_told(server):
    url, optimiser = server
    method = OutsideMethod(Outside(kind="outside", url=url), ABOUT, Path())
    assert asked(method, "+-+") == [0.8, 0.4, pytest.approx(0.6), None]
    assert optimiser.said[1:] == [(0.8, True), (0.4, False), (pytest.approx(0.6), True)]


def test_an_optimiser_in_python_beside_the_file_is_asked_and_told(monkeypatch, tmp_path):
    (tmp_path / "my_optimiser.py").write_text(f"from {Halving.__module__} import Halving as Mine\n")
    monkeypatch.setitem(sys.modules, Halving.__module__, sys.modules[__name__])
    method = OutsideMethod(
        Outside(kind="outside", python="my_optimiser:Mine", trials=2), ABOUT, tmp_path
    )
    assert asked(method, "++") == [0.8, 0.4, None]  # two trials, whatever it wants
    assert str(tmp_path) not in sys.path


@pytest.mark.parametrize(
    ("settings", "error", "code"),
    [
        ({"python": "no_such_module:Mine"}, BadInputError, "bad_optimiser"),
        ({"python": "json:Nothing"}, BadInputError, "bad_optimiser"),
        ({"url": "http://127.0.0.1:1"}, HapticError, "no_optimiser"),
    ],
)
def test_an_optimiser_that_cannot_be_had_is_said(settings, error, code):
    with refused(code, kind=error):
        OutsideMethod(Outside(kind="outside", **settings), ABOUT, Path()).suggest()


def test_the_code_on_the_page_about_experiments_runs(capsys):
    page = Path(__file__).resolve().parents[4] / "docs" / "experiments.md"
    optimiser, by_hand = re.findall(
        r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    names = {}
    exec(optimiser, names)
    mine = names["Mine"](**ABOUT)
    mine.report(mine.suggest(), True)
    assert mine.suggest() == pytest.approx(0.32)
    exec(by_hand, {})
    assert float(capsys.readouterr().out) == pytest.approx(0.12, rel=0.3)


def test_a_staircase_walks_on_where_few_textures_stand_for_its_levels():
    """Steps of a tenth, textures far apart: the level that is presented stays, and then jumps."""
    settings = Staircase(
        kind="staircase", start=0.3, steps=[0.1], scale="linear", low=0.0, high=0.5, down=1
    )
    condition = Condition(
        name="a",
        texture="t",
        comparisons=[Comparison(level=0.0, texture="x"), Comparison(level=0.3, texture="y")],
    )
    staircase, presented = StaircaseMethod(settings), []
    for _ in range(4):
        presented.append(condition.available(staircase.suggest()))
        staircase.report(presented[-1], True)
    assert presented == [0.3, 0.3, 0.0, 0.0]
