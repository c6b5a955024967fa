"""NI cards against a fake nidaqmx that knows only what the package documents, with its real
constants and errors.
"""

from __future__ import annotations

import inspect
import sys
import threading
from typing import Any

import nidaqmx.task
import numpy as np
import pytest
from nidaqmx.task import InStream, OutStream
from nidaqmx.task import Timing as RealTiming
from nidaqmx.task.channels import AIChannel
from nidaqmx.task.collections import (
    AIChannelCollection,
    AOChannelCollection,
    DIChannelCollection,
    DOChannelCollection,
)

from hw.analog.ni_daq import (
    NiAnalogInput,
    NiAnalogInputs,
    NiAnalogOutput,
    NiCards,
    NiDigitalInput,
    NiDigitalOutput,
    NiEventLine,
    NiLineIn,
)
from hw.analog.output import AnalogOutputSettings, CardReserved, OutputUnderrun, at_zero
from hw.errors import (
    DeviceDisconnected,
    DeviceError,
    DeviceTimeout,
    InstrumentRejected,
    LimitExceeded,
)
from hw.monitor.lines import MonitorLines, SampledMonitor, Sampling
from tests.hw.testing.ni_card import (
    NAMES,
    AIChannelFake,
    AIChannels,
    AOChannels,
    Card,
    DIChannels,
    DOChannels,
    InStreamFake,
    OutStreamFake,
    Task,
    Timing,
    install,
)

SETTINGS = AnalogOutputSettings(
    low_v=-5.0,
    high_v=5.0,
    zero_level_v=-5.0,
    sample_rate_limit_hz=100e3,
    buffer_s=0.1,
    lease_s=0.5,
    timeout_s=0.2,
)


@pytest.fixture
def card(monkeypatch):
    return install(monkeypatch)


def inputs_on(card: Card, rate_hz: float = 1000.0, **kwargs: Any) -> NiAnalogInputs:
    return NiAnalogInputs(
        NAMES,
        sample_rate_hz=rate_hz,
        timeout_s=0.2,
        clock=lambda: card.now_s,
        sleep=card.advance,
        **kwargs,
    )


def output_on(card: Card) -> NiAnalogOutput:
    return NiAnalogOutput("Dev1/ao0", SETTINGS, clock=lambda: card.now_s, watch=False)


@pytest.mark.parametrize(
    ("fake", "real"),
    [
        (AIChannels.add_ai_voltage_chan, AIChannelCollection.add_ai_voltage_chan),
        (AOChannels.add_ao_voltage_chan, AOChannelCollection.add_ao_voltage_chan),
        (DIChannels.add_di_chan, DIChannelCollection.add_di_chan),
        (DOChannels.add_do_chan, DOChannelCollection.add_do_chan),
        (Timing.cfg_samp_clk_timing, RealTiming.cfg_samp_clk_timing),
        (Task.read, nidaqmx.task.Task.read),
        (Task.write, nidaqmx.task.Task.write),
        (Task.start, nidaqmx.task.Task.start),
        (Task.close, nidaqmx.task.Task.close),
    ],
)
def test_the_fake_takes_the_arguments_of_the_real_package_in_its_order(fake, real):
    expected = list(inspect.signature(real).parameters)
    given = list(inspect.signature(fake).parameters)
    assert given == expected[: len(given)]


def test_the_fake_has_no_attribute_that_the_real_package_lacks():
    for fake, real in (
        (Task, nidaqmx.task.Task),
        (InStreamFake, InStream),
        (OutStreamFake, OutStream),
        (Timing, RealTiming),
        (AIChannelFake, AIChannel),
    ):
        public = [name for name in dir(fake) if not name.startswith("_") and name != "card"]
        assert public
        assert [name for name in public if not hasattr(real, name)] == []


@pytest.mark.process
def test_the_real_package_without_its_driver_says_what_to_install():
    for device in (NiAnalogInputs(NAMES, sample_rate_hz=1e3), NiDigitalOutput("Dev1/port0/line0")):
        with pytest.raises(DeviceDisconnected, match="NI-DAQmx driver is not installed") as caught:
            device.open()
        assert "install NI-DAQmx" in caught.value.hint


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    monkeypatch.setitem(sys.modules, "nidaqmx.constants", None)
    with pytest.raises(DeviceError) as caught:
        NiDigitalInput("Dev1/port0/line0").read()
    assert "haptic-driver[ni]" in caught.value.hint


def test_inputs_give_the_newest_samples_oldest_first(card):
    card.signals["Dev1/ai1"] = lambda t: t
    inputs = inputs_on(card)
    inputs.open()
    card.advance(0.1)
    samples_v = inputs.latest_v(3)
    assert samples_v.tolist() == [[0.0, 0.097, 2.0], [0.0, 0.098, 2.0], [0.0, 0.099, 2.0]]
    assert inputs.columns(["Dev1/ai2", "Dev1/ai0"]).latest_v(1).tolist() == [[2.0, 0.0]]


def test_inputs_wait_for_the_first_samples_and_no_longer_than_the_timeout(card):
    inputs = inputs_on(card)
    inputs.open()
    assert inputs.latest_v(20).shape == (20, 3)
    assert card.now_s == pytest.approx(0.02, abs=0.002)
    with pytest.raises(DeviceTimeout):
        inputs.latest_v(2000)  # two seconds away
    assert card.now_s == pytest.approx(0.22, abs=0.005)


def test_a_clock_that_stopped_while_nobody_looked_is_noticed_at_the_first_look(card):
    inputs = inputs_on(card)
    inputs.open()
    inputs.latest_v(5)
    card.advance(1.0)
    card.ai_clock_runs = False
    card.advance(5.0)
    with pytest.raises(DeviceTimeout, match="has not sampled"):
        inputs.latest_v(5)
    card.ai_clock_runs = True
    assert inputs.latest_v(5).shape == (5, 3)


def test_a_monitor_of_an_alternating_voltage_reads_its_peak(card):
    card.signals["Dev1/ai2"] = lambda t: 1.5 * np.sin(2.0 * np.pi * 70.0 * t)
    inputs = inputs_on(card)
    inputs.open()
    peak = NiAnalogInput(inputs, "Dev1/ai2", window_s=0.1, peak=True)
    mean = NiAnalogInput(inputs, "Dev1/ai2", window_s=0.1, peak=False)
    assert peak.read_v() == pytest.approx(1.5, rel=0.03)
    assert mean.read_v() == pytest.approx(0.0, abs=1e-9)  # seven whole periods


def test_a_second_input_task_is_refused_by_the_card_in_its_own_words(card):
    inputs_on(card).open()
    with pytest.raises(InstrumentRejected, match="-50103"):
        inputs_on(card).open()


def test_a_failed_opening_releases_its_task(card):
    unknown = NiAnalogInputs(["Dev1/ai9"], sample_rate_hz=1e3)
    with pytest.raises(InstrumentRejected, match="-200170"):
        unknown.open()
    assert card.tasks == []


@pytest.mark.parametrize(
    "bad", [{"terminal": "DIFFERENTIAL"}, {"channels": []}, {"channels": ["a", "a"]}]
)
def test_impossible_inputs_are_refused(bad):
    with pytest.raises(ValueError, match=r"terminal|channels"):
        NiAnalogInputs(**({"channels": NAMES, "sample_rate_hz": 1e3} | bad))


def test_closed_inputs_say_so(card):
    inputs = inputs_on(card)
    inputs.open()
    inputs.close()
    inputs.close()
    assert card.tasks == []
    with pytest.raises(DeviceDisconnected):
        inputs.latest_v(1)


def test_a_line_out_is_read_back_and_a_line_in_is_its_level(card):
    out, line = NiDigitalOutput("Dev1/port0/line0"), NiDigitalInput("Dev1/port0/line1")
    out.write(True)
    assert out.read() is card.lines["Dev1/port0/line0"] is line.read() is True
    card.lines["Dev1/port0/line1"] = False
    assert line.read() is False
    card.broken = True
    with pytest.raises(DeviceError):
        out.read()
    line.close()


@pytest.mark.parametrize(
    ("fault", "hint"),
    [
        ((-200361, "Onboard device memory overflow."), "lower sample rate"),
        ((-200279, "The application is not able to keep up."), "lower sample rate"),
        ((-88709, "The specified device is not present."), "NI MAX"),
    ],
)
def test_a_card_whose_samples_are_not_fetched_in_time_is_told_from_a_wrong_one(card, fault, hint):
    inputs = inputs_on(card)
    inputs.open()
    card.fault, card.broken = fault, True
    with pytest.raises(InstrumentRejected, match=fault[1]) as caught:
        inputs.latest_v(10)
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("lines", "levels"), [("Dev1/port0/line0:7", [0, 37, 0]), ("Dev1/port0/line0", [0, 1, 0])]
)
def test_an_event_line_takes_a_code_or_an_edge(card, lines, levels):
    line = NiEventLine(lines)
    line.open()
    seen = [card.lines[lines]]
    line.put(37)
    seen.append(card.lines[lines])
    line.close()
    assert [*seen, card.lines[lines]] == levels
    assert card.tasks == []


def test_a_line_in_is_its_level(card):
    line = NiLineIn("Dev1/port0/line1")
    line.open()
    card.lines["Dev1/port0/line1"] = False
    assert line.levels() == (False,)
    card.lines["Dev1/port0/line1"] = True
    assert line.levels() == (True,)
    line.close()
    assert card.tasks == []


def test_opening_the_output_sets_the_zero_level_and_closing_leaves_it(card):
    with output_on(card) as output:
        assert card.ao_v == -5.0
        output.hold(2.0)
        assert card.ao_v == 2.0
    assert card.ao_v == -5.0
    assert card.tasks == []


def test_a_stream_is_played_without_gap_or_repeat(card):
    envelope_v = 4.0 * np.sin(np.linspace(0.0, 20.0, 5000))
    with output_on(card) as output:
        for block_v in np.split(envelope_v, 10):  # 10 ms blocks at 50 kS/s
            output.write(block_v, 50e3)
            if output.buffered_s > 0.02:
                card.advance(0.01)
        card.advance(0.02)
        assert card.played_v == envelope_v.tolist()
        assert output.buffered_s == pytest.approx(0.0, abs=1e-9)


def test_a_stream_that_runs_dry_goes_to_zero_and_is_reported_once(card):
    with output_on(card) as output:
        output.write(np.full(500, 3.0), 50e3)
        card.advance(0.02)
        assert card.ao_v == 3.0  # the card keeps its last sample
        output.write(np.full(500, 2.0), 50e3)  # soon enough: the stream goes on
        assert output.gaps == 1
        card.advance(0.1)
        assert card.ao_v == 2.0
        with pytest.raises(OutputUnderrun):
            output.write(np.full(500, 3.0), 50e3)
        assert card.ao_v == -5.0
        output.check()
        output.write(np.full(500, 1.0), 50e3)
        card.advance(0.005)
        assert card.ao_v == 1.0


def test_holding_and_zero_end_a_stream_at_once(card):
    with output_on(card) as output:
        output.write(np.full(2000, 3.0), 50e3)
        card.advance(0.01)
        output.hold(1.0)
        card.advance(0.1)
        assert card.ao_v == 1.0
        output.write(np.full(2000, 3.0), 50e3)
        card.advance(0.01)
        output.zero()
        card.advance(0.1)
        assert card.ao_v == -5.0
        output.check()


def test_a_card_that_disappears_is_reported_as_not_known_to_be_at_zero(card):
    output = output_on(card)
    output.open()
    output.write(np.full(500, 3.0), 50e3)
    card.broken = True
    with pytest.raises(InstrumentRejected, match="NOT known to be at zero"):
        output.check()
    assert output.level_v is None
    with pytest.raises(InstrumentRejected):
        output.close()
    card.broken = False
    output.open()
    assert card.ao_v == -5.0
    assert output.level_v == -5.0
    output.close()


def test_the_watch_thread_zeroes_a_dry_stream_by_itself(card):
    output = NiAnalogOutput("Dev1/ao0", SETTINGS)  # real time, watched
    zeroed = threading.Event()
    plain = output._set_level

    def noted(level_v: float) -> None:
        plain(level_v)
        zeroed.set()

    with output:
        output._set_level = noted  # type: ignore[method-assign]
        output.write(np.full(500, 3.0), 50e3)
        card.advance(1.0)
        assert zeroed.wait(20.0)
        assert card.ao_v == -5.0
        with pytest.raises(OutputUnderrun):
            output.check()


@pytest.mark.parametrize("asked_hz", [48e3, 44.1e3, 30e3])
def test_an_alternating_voltage_is_read_at_the_rate_that_the_card_got(card, asked_hz):
    """100 V at 8 kHz: at the rate that was asked for they read as 30, 57 and 65 V."""
    card.signals["Dev1/ai0"] = lambda t: 1.0 * np.sin(2.0 * np.pi * 8e3 * t)
    card.signals["Dev1/ai1"] = lambda t: 0.5 * np.cos(2.0 * np.pi * 8e3 * t)
    inputs = inputs_on(card, asked_hz)
    inputs.open()
    card.advance(0.5)
    monitor = SampledMonitor(
        inputs.columns(["Dev1/ai0", "Dev1/ai1"]), MonitorLines(0.01, 100.0), Sampling(0.1)
    )
    found = monitor.read(8e3, 100.0)
    assert abs(found.voltage_v) == pytest.approx(100.0, rel=1e-6)
    assert found.current_a == pytest.approx(5e-3j, rel=1e-5)
    assert inputs.sample_rate_hz > asked_hz


def test_a_card_that_is_slower_than_the_file_says_is_refused(card):
    """The file's limits on carriers count on its rate."""
    card.timebase_hz = 40e3
    with pytest.raises(InstrumentRejected, match=r"48000.* it is 40000"):
        inputs_on(card, 48e3).open()
    assert card.tasks == []


def test_each_channel_may_have_its_own_terminal(card):
    inputs = inputs_on(card, terminal=dict(zip(NAMES, ("RSE", "DIFF", "NRSE"), strict=True)))
    inputs.open()
    held = {one.name: one.got for one in inputs.held() if "terminal" in one.name}
    assert list(held.values()) == ["RSE", "DIFF", "NRSE"]
    with pytest.raises(ValueError, match="terminal"):
        inputs_on(card, terminal={"Dev1/ai0": "RSE"})


def test_a_smaller_buffer_is_how_far_back_a_monitor_looks(card):
    card.most_samples = 500
    inputs = inputs_on(card, 10e3, buffer_s=1.0)
    inputs.open()
    assert inputs.buffer_s == pytest.approx(0.05)
    monitor = SampledMonitor(inputs.columns(NAMES[:2]), MonitorLines(0.01, 100.0), Sampling(0.1))
    assert monitor.frequency_range_hz[0] == pytest.approx(20.0)
    with pytest.raises(LimitExceeded):
        monitor.read(15.0, 1.0)


def test_what_the_converter_takes_between_channels_is_the_cards_word(card):
    card.convert_rate_hz = 200e3
    inputs = inputs_on(card)
    inputs.open()
    assert list(inputs.columns(NAMES).lags_s) == pytest.approx([0.0, 5e-6, 10e-6])
    with pytest.raises(InstrumentRejected, match="conversion_interval_s"):
        _ = inputs.columns(NAMES, conversion_interval_s=1e-5).lags_s
    card.convert_rate_hz = None  # of a card that does not say
    inputs.close()
    inputs.open()
    assert list(inputs.columns(NAMES, 1e-5).lags_s) == pytest.approx([0.0, 1e-5, 2e-5])


def test_two_cards_have_a_task_each_and_what_belongs_together_is_of_one(card):
    card.signals["Dev2/ai0"] = lambda t: 7.0 + 0.0 * t
    made = [
        NiAnalogInputs(
            names, sample_rate_hz=1e3, clock=lambda: card.now_s, sleep=card.advance, timeout_s=0.2
        )
        for names in (NAMES, ("Dev2/ai0",))
    ]
    cards = NiCards(made)
    cards.open()
    card.advance(0.1)
    assert cards.columns(["Dev2/ai0"]).latest_v(1).tolist() == [[7.0]]
    assert cards.columns(["Dev1/ai1"]).latest_v(1).tolist() == [[1.0]]
    with pytest.raises(ValueError, match="not sampled by one card"):
        cards.columns(["Dev1/ai0", "Dev2/ai0"])
    cards.close()
    assert card.tasks == []


def test_what_is_at_the_output_is_looked_at_through_the_card_without_opening_it(card):
    output = output_on(card)
    assert output.read_back_v() is None  # a card without the channel inside
    card.signals["Dev1/_ao0_vs_aognd"] = lambda t: card.ao_v
    assert output.read_back_v() == 3.0
    with output:
        assert output.read_back_v() == 5.0
        card.signals["Dev1/_ao0_vs_aognd"] = lambda t: 0.1  # whatever it was told
        assert output.read_back_v() == pytest.approx(0.1)
    assert card.tasks == []


def test_a_card_that_another_program_keeps_is_reset_and_reads_zero(card):
    """A stopped control keeps its task: the watchdog's own was refused, with a voltage out."""
    kept = output_on(card)
    kept.open()
    kept.write(np.full(50, 2.0), 1000.0)
    card.advance(0.02)
    assert card.ao_v == 2.0
    other = NiAnalogOutput("Dev1/ao0", at_zero(0.2), clock=lambda: card.now_s, watch=False)
    with pytest.raises(CardReserved, match="used by another program"):
        other.open()
    other.reset()
    assert card.ao_v == 0.0
    other.open()
    other.close()
    with pytest.raises(DeviceError):
        kept.write(np.full(50, 2.0), 1000.0)
    assert card.ao_v <= 0.0
