"""What must hold for every kind of generator, whatever its driver is asked, with its simulator
behind it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import BadReply, InstrumentRejected, LimitExceeded
from hw.generator.contract import GeneratorLatency, generator_kind
from hw.generator.settings import ExternalModulation, ModulationInput, RangePolicy, Shape
from hw.serving.memory import MemoryTransport
from tests.hw.generator.kinds import GAIN, KINDS, LIMIT_V, MODULATED, SETTINGS, Bench
from tests.hw.instruments import IMMEDIATE

ROUNDING = 1.0 + 1e-6
every_kind = pytest.mark.parametrize("name", KINDS)

NUMBER = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(0.0, 400.0),
    st.floats(1.0, 300.0),
    st.sampled_from([300.0, math.nextafter(300.0, 400.0), 1.0, 0.0, -300.0]),
)
FREQUENCY = st.one_of(st.floats(10.0, 10e3), st.floats(allow_nan=True, allow_infinity=True))
OFFSET = st.one_of(
    st.just(0.0), st.floats(-310.0, 310.0), st.sampled_from([300.0, -300.0, math.inf])
)
SHAPE = st.sampled_from([Shape.SINE, Shape.SINE, Shape.SQUARE, Shape.DC])
MODULATION = st.sampled_from([None, None, ExternalModulation()])
SET_POINT = st.builds(
    lambda f, v, o, s, m: lambda d: d.set_point(f, v, o, shape=s, modulation=m),
    FREQUENCY,
    NUMBER,
    OFFSET,
    SHAPE,
    MODULATION,
)
OTHER: st.SearchStrategy[Callable[[Any], object]] = st.sampled_from(
    [
        lambda d: d.set_output(True),
        lambda d: d.set_output(False),
        lambda d: d.off(),
        lambda d: d.connect(),
        lambda d: d.identify(),
    ]
)


@every_kind
@settings(max_examples=60)
@given(
    data=st.data(),
    calls=st.lists(st.one_of(SET_POINT, SET_POINT, OTHER), max_size=15),
    factor=st.sampled_from([1.0, 2.0, 0.5]),
    policy=st.sampled_from(list(RangePolicy)),
    slow=st.booleans(),
)
def test_nothing_that_a_driver_is_told_exceeds_the_limit_and_off_is_off(
    name, data, calls, factor, policy, slow
):
    """At every change at the terminals, whatever was left behind, with the envelope at its
    highest.
    """
    wired = replace(SETTINGS, modulation_input=ModulationInput(5.0, factor), range_policy=policy)
    bench = Bench(name, wired, GeneratorLatency() if slow else IMMEDIATE, am_full_scale=factor)
    bench.generator.set_modulation_input(5.0)
    for words in data.draw(st.lists(st.sampled_from(bench.words.left_behind), max_size=8)):
        bench.say(words)
    bench.generator.advance(1.0)
    bench.connect()
    bench.generator.advance(1.0)
    bench.driver.set_output(True)
    for call in calls:
        with suppress(LimitExceeded, InstrumentRejected):
            call(bench.driver)
        bench.generator.advance(0.05)
    bench.generator.advance(1.0)
    assert bench.peak_v <= LIMIT_V * ROUNDING
    assert bench.driver.off() is True
    bench.generator.advance(1.0)
    assert not bench.generator.output().on


@every_kind
@settings(max_examples=60)
@given(
    points=st.lists(
        st.tuples(st.floats(10.0, 10e3), st.floats(1.0, 300.0)), min_size=2, max_size=20
    )
)
def test_nothing_in_between_exceeds_what_was_asked(name, points):
    bench = Bench(name)
    bench.connect()
    bench.driver.set_output(True)
    bench.driver.set_point(*points[0])
    for (old_hz, old_v), (new_hz, new_v) in pairwise(points):
        bench.seen.clear()
        bench.driver.set_point(new_hz, new_v)
        for output in bench.seen:
            assert GAIN * output.amplitude_v <= max(old_v, new_v) * ROUNDING
            product = GAIN * output.amplitude_v * output.frequency_hz
            assert product <= max(old_v * old_hz, new_v * new_hz) * ROUNDING


@every_kind
@settings(max_examples=60)
@given(
    points=st.lists(
        st.tuples(st.floats(10.0, 10e3), st.floats(1.0, 150.0), st.floats(-150.0, 150.0)),
        min_size=2,
        max_size=10,
    )
)
def test_no_step_between_two_set_points_is_above_both(name, points):
    bench = Bench(name)
    bench.connect()
    bench.driver.set_output(True)
    bench.driver.set_point(*points[0])
    for old, new in pairwise(points):
        bench.peak_v = 0.0
        bench.driver.set_point(*new)
        assert bench.peak_v <= max(old[1] + abs(old[2]), new[1] + abs(new[2])) * ROUNDING


@every_kind
@settings(max_examples=30)
@given(
    point=st.tuples(FREQUENCY, NUMBER).filter(
        lambda p: not (10.0 <= p[0] <= 10e3 and 0.05 <= p[1] <= 300.0)
    )
)
def test_a_refused_set_point_changes_nothing(name, point):
    bench = Bench(name)
    bench.connect()
    bench.driver.set_output(True)
    before = bench.generator.output()
    with pytest.raises(LimitExceeded):
        bench.driver.set_point(*point)
    assert bench.generator.output() == before


@every_kind
def test_a_set_point_is_volts_at_the_electrode(name):
    bench = Bench(name)
    bench.connect()
    bench.driver.set_point(250.0, 120.0)
    assert bench.voltage_v == 0.0
    bench.driver.set_output(True)
    assert bench.generator.output()[:4] == (250.0, pytest.approx(1.2), 0.0, True)
    bench.driver.set_point(260.0, bench.driver.minimum_voltage_v)
    assert bench.voltage_v == pytest.approx(bench.driver.minimum_voltage_v)
    assert bench.driver.close() is True
    assert not bench.generator.output().on


@every_kind
def test_a_load_changed_behind_the_driver_is_noticed_and_switched_off(name):
    """The amplitude alone reads back as it was set, while the electrode gets twice that."""
    bench = Bench(name)
    bench.connect()
    bench.driver.set_point(250.0, 120.0)
    bench.driver.set_output(True)
    bench.say(bench.words.higher)
    assert bench.voltage_v == pytest.approx(240.0)
    with pytest.raises(BadReply):
        bench.driver.set_point(260.0, 120.0)
    assert bench.voltage_v == 0.0
    bench.driver.set_point(250.0, 60.0)
    bench.driver.set_output(True)
    assert bench.voltage_v == pytest.approx(60.0)


@every_kind
def test_the_last_gate_holds_when_the_drivers_own_reckoning_is_wrong(name, monkeypatch):
    bench = Bench(name)
    bench.connect()
    bench.driver.set_point(250.0, 100.0)
    bench.driver.set_output(True)
    driver = type(bench.driver)
    right = driver._wanted

    def twice_too_much(*arguments: Any) -> Any:
        wanted = right(*arguments)
        return wanted._replace(amplitude_vpp=2.0 * wanted.amplitude_vpp)

    monkeypatch.setattr(driver, "_wanted", twice_too_much)
    with pytest.raises(LimitExceeded, match="last gate"):
        bench.driver.set_point(250.0, 200.0)
    assert bench.peak_v == pytest.approx(100.0)


@every_kind
def test_identifying_only_asks(name):
    bench = Bench(name)
    bench.say(bench.words.on)
    before = bench.generator.output()
    found = bench.driver.identify()
    assert found.output_on
    assert bench.generator.output() == before
    assert found.identity.split()[0] in ("Agilent", "Siglent")
    assert found.serial_number.startswith("SIM")
    bench.say("*RST")
    assert bench.driver.identify().output_on is False


@every_kind
def test_another_kinds_instrument_is_refused_and_left_alone(name):
    for other in KINDS:
        if other != name:
            bench, wrong = Bench(name), Bench(other)
            driver: Any = bench.kind.make(MemoryTransport(wrong.generator), SETTINGS)
            wrong.say(wrong.words.on)
            with pytest.raises(BadReply, match=r"SIM.*, not a"):
                driver.connect()
            assert wrong.generator.output().on


@every_kind
def test_the_watchdogs_words_switch_off_and_are_understood(name):
    bench = Bench(name)
    kind = bench.kind
    bench.connect()
    bench.driver.set_output(True)
    match = kind.off_answers.fullmatch(bench.generator.handle(kind.ask_off).strip())
    assert match is not None
    assert match["off"] is None
    assert bench.generator.handle(kind.switch_off) == b""
    assert not bench.generator.output().on
    match = kind.off_answers.fullmatch(bench.generator.handle(kind.ask_off).strip())
    assert match is not None
    assert match["off"] is not None
    assert kind.off_answers.fullmatch(b"?") is None
    assert kind.off_answers.fullmatch(b"") is None


@every_kind
def test_what_the_kind_says_is_what_the_driver_does(name):
    bench = Bench(name, MODULATED)
    kind = bench.kind
    assert bench.driver.minimum_voltage_v == pytest.approx(0.5 * kind.amplitude_low_vpp * GAIN)
    bench.connect()
    if kind.external_modulation:
        bench.driver.set_point(250.0, 200.0, modulation=ExternalModulation())
        bench.driver.set_output(True)
        assert bench.voltage_v == pytest.approx(100.0)  # an open input is half of it
    else:
        with pytest.raises(LimitExceeded, match="not modulated"):
            bench.driver.set_point(250.0, 200.0, modulation=ExternalModulation())


def test_an_unknown_kind_names_the_nearest_and_all():
    with pytest.raises(
        ValueError,
        match=r"'keysight_33500b' .*did you mean 'keysight_33500'.*agilent_33220a.*siglent",
    ):
        generator_kind("keysight_33500b")
