"""NI cards against a fake nidaqmx that knows only what the package documents, with its real
constants and errors.
"""

from __future__ import annotations

import inspect
import sys
import threading
from types import ModuleType
from typing import Any

import nidaqmx.constants
import nidaqmx.errors
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

from hw.amplifier.analog import AmplifierSettings, AmplifierState, AnalogAmplifier
from hw.analog.ni_daq import (
    NiAnalogInput,
    NiAnalogInputs,
    NiAnalogOutput,
    NiDigitalInput,
    NiDigitalOutput,
)
from hw.analog.output import AnalogOutputSettings, OutputUnderrun
from hw.errors import (
    DeviceDisconnected,
    DeviceError,
    DeviceTimeout,
    InstrumentRejected,
    LimitExceeded,
)

constants = nidaqmx.constants
NAMES = ("Dev1/ai0", "Dev1/ai1", "Dev1/ai2")
SETTINGS = AnalogOutputSettings(
    low_v=-5.0,
    high_v=5.0,
    zero_level_v=-5.0,
    sample_rate_limit_hz=100e3,
    buffer_s=0.1,
    lease_s=0.5,
    timeout_s=0.2,
)


def daq_error(code: int, text: str) -> Exception:
    error: Exception = nidaqmx.errors.DaqError(text, code)
    return error


class Card:
    """What is behind the driver: a clock, input signals, a port, one output that keeps its last
    sample.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self.signals = {name: lambda t, offset=i: offset + 0.0 * t for i, name in enumerate(NAMES)}
        self.ai_clock_runs = True
        self.lines = {"Dev1/port0/line0": False, "Dev1/port0/line1": True}
        self.ao_v = 3.0  # left from before
        self.played_v: list[float] = []
        self.owners: dict[str, Any] = {}
        self.tasks: list[Any] = []
        self.broken = False
        self.timebase_hz = 20e6
        self.ranges_v = (0.1, 1.0, 5.0, 10.0)
        self.terminals: dict[str, Any] = {}  # what the card makes of one that was asked for
        self.convert_rate_hz: float | None = None

    def advance(self, dt_s: float) -> None:
        self.now_s += dt_s
        for task in self.tasks:
            task._advance(dt_s)

    def check(self) -> None:
        if self.broken:
            raise daq_error(
                -88709, "The specified device is not present or is not active in the system."
            )

    def reserve(self, resource: str, task: Any) -> None:
        self.check()
        if self.owners.setdefault(resource, task) is not task:
            raise daq_error(-50103, "The specified resource is reserved.")


class _Channels:
    __slots__ = ("_task",)

    def __init__(self, task: Any) -> None:
        self._task = task

    def _add(self, physical: str, known: Any) -> None:
        self._task._card.check()
        if physical not in known:
            raise daq_error(-200170, "Physical channel specified does not exist on this device.")
        self._task._names.append(physical)


class AIChannels(_Channels):
    __slots__ = ()

    def add_ai_voltage_chan(
        self,
        physical_channel: str,
        name_to_assign_to_channel: str = "",
        terminal_config: Any = constants.TerminalConfiguration.DEFAULT,
        min_val: float = -5.0,
        max_val: float = 5.0,
    ) -> AIChannelFake:
        assert isinstance(terminal_config, constants.TerminalConfiguration)
        card = self._task._card
        self._add(physical_channel, card.signals)
        made = card.terminals.get(terminal_config.name, terminal_config)
        range_v = next((r for r in card.ranges_v if r >= max_val), card.ranges_v[-1])
        return AIChannelFake(made, range_v)


class AIChannelFake:
    """What of nidaqmx.AIChannel is read back."""

    __slots__ = ("ai_rng_high", "ai_rng_low", "ai_term_cfg")

    def __init__(self, terminal: Any, range_v: float) -> None:
        self.ai_term_cfg, self.ai_rng_low, self.ai_rng_high = terminal, -range_v, range_v


class AOChannels(_Channels):
    __slots__ = ()

    def add_ao_voltage_chan(
        self,
        physical_channel: str,
        name_to_assign_to_channel: str = "",
        min_val: float = -10.0,
        max_val: float = 10.0,
    ) -> None:
        self._add(physical_channel, ("Dev1/ao0",))
        self._task._ao_range_v = (min_val, max_val)


class DIChannels(_Channels):
    __slots__ = ()

    def add_di_chan(self, lines: str, name_to_assign_to_lines: str = "") -> None:
        self._add(lines, self._task._card.lines)


class DOChannels(_Channels):
    __slots__ = ()

    def add_do_chan(self, lines: str, name_to_assign_to_lines: str = "") -> None:
        self._add(lines, self._task._card.lines)


class Timing:
    __slots__ = ("_task",)

    def __init__(self, task: Any) -> None:
        self._task = task

    def cfg_samp_clk_timing(
        self,
        rate: float,
        source: str = "",
        active_edge: Any = constants.Edge.RISING,
        sample_mode: Any = constants.AcquisitionType.FINITE,
        samps_per_chan: int = 1000,
    ) -> None:
        assert sample_mode is constants.AcquisitionType.CONTINUOUS
        assert isinstance(samps_per_chan, int)
        self._task._rate_hz = self._divided(rate)
        self._task._buffer = samps_per_chan

    def _divided(self, rate_hz: float) -> float:
        """As NI's knowledge base says: inputs round the divisor down, outputs to the nearest."""
        divisor = self._task._card.timebase_hz / rate_hz
        whole = np.floor(divisor + 1e-9) if "ai" in self._task._names[0] else np.round(divisor)
        return float(self._task._card.timebase_hz / whole)

    @property
    def samp_clk_rate(self) -> float:
        return float(self._task._rate_hz)

    @property
    def ai_conv_rate(self) -> float:
        if self._task._card.convert_rate_hz is None:
            raise daq_error(-200452, "Specified property is not supported by the device.")
        return float(self._task._card.convert_rate_hz)


class InStreamFake:
    __slots__ = ("_task", "offset", "overwrite", "relative_to")

    def __init__(self, task: Any) -> None:
        self._task = task
        self.offset = 0
        self.overwrite = constants.OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES
        self.relative_to = constants.ReadRelativeTo.CURRENT_READ_POSITION

    @property
    def input_buf_size(self) -> int:
        return int(self._task._buffer)

    @property
    def total_samp_per_chan_acquired(self) -> int:
        self._task._card.check()
        return int(self._task._samples + 1e-6)


class OutStreamFake:
    __slots__ = ("_task", "output_buf_size", "regen_mode")

    def __init__(self, task: Any) -> None:
        self._task = task
        self.output_buf_size = 0
        self.regen_mode = constants.RegenerationMode.ALLOW_REGENERATION

    @property
    def total_samp_per_chan_generated(self) -> int:
        self._task._check_stream()
        return int(self._task._generated)


class Task:
    """What of nidaqmx.Task may be used; anything else is an AttributeError, read or written."""

    card: Card
    __slots__ = (
        "_ao_range_v",
        "_buffer",
        "_card",
        "_closed",
        "_dry",
        "_generated",
        "_names",
        "_owed",
        "_queue",
        "_rate_hz",
        "_samples",
        "_started",
        "ai_channels",
        "ao_channels",
        "di_channels",
        "do_channels",
        "in_stream",
        "out_stream",
        "timing",
    )

    def __init__(self, new_task_name: str = "") -> None:
        self._card = type(self).card
        self._card.check()
        self._names: list[str] = []
        self._queue: list[float] = []
        self._rate_hz = self._samples = self._owed = 0.0
        self._buffer = self._generated = 0
        self._started = self._dry = self._closed = False
        self.ai_channels, self.ao_channels = AIChannels(self), AOChannels(self)
        self.di_channels, self.do_channels = DIChannels(self), DOChannels(self)
        self.in_stream, self.out_stream, self.timing = (
            InStreamFake(self),
            OutStreamFake(self),
            Timing(self),
        )
        self._card.tasks.append(self)

    def start(self) -> None:
        self._card.reserve("ai clock" if "ai" in self._names[0] else self._names[0], self)
        if "ao" in self._names[0] and not self._queue:
            raise daq_error(
                -200462, "Generation cannot be started, because the output buffer is empty."
            )
        self._started = True

    def close(self) -> None:
        assert not self._closed
        self._closed = True
        self._card.tasks.remove(self)
        for resource in [key for key, owner in self._card.owners.items() if owner is self]:
            del self._card.owners[resource]

    def read(self, number_of_samples_per_channel: Any = None, timeout: float = 10.0) -> Any:
        self._card.check()
        if self._names[0] in self._card.lines:
            assert number_of_samples_per_channel is None
            return self._card.lines[self._names[0]]
        count = number_of_samples_per_channel
        assert self.in_stream.relative_to is constants.ReadRelativeTo.MOST_RECENT_SAMPLE
        assert self.in_stream.overwrite is constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
        assert self.in_stream.offset == -count
        total = self.in_stream.total_samp_per_chan_acquired
        if count > total or count > self._buffer:
            raise daq_error(-200277, "Attempted to read samples that are no longer available.")
        times_s = np.arange(total - count, total) / self._rate_hz
        rows = [[float(self._card.signals[name](t)) for t in times_s] for name in self._names]
        return rows if len(rows) > 1 else rows[0]

    def write(self, data: Any, auto_start: Any = None, timeout: float = 10.0) -> int:
        self._card.check()
        if self._names[0] in self._card.lines:
            assert isinstance(data, bool)
            self._card.reserve(self._names[0], self)
            self._card.lines[self._names[0]] = data
            return 1
        samples = np.atleast_1d(np.asarray(data, dtype=np.float64))
        low_v, high_v = self._ao_range_v
        assert samples.min() >= low_v
        assert samples.max() <= high_v
        self._card.reserve(self._names[0], self)
        if not self._rate_hz:
            assert auto_start is True
            self._card.ao_v = float(samples[-1])
            return 1
        assert auto_start is False
        assert self.out_stream.regen_mode is constants.RegenerationMode.DONT_ALLOW_REGENERATION
        self._check_stream()
        if len(self._queue) + samples.size > self.out_stream.output_buf_size:
            raise daq_error(-200293, "No space.")
        self._queue += samples.tolist()
        return int(samples.size)

    def _check_stream(self) -> None:
        self._card.check()
        if self._dry:
            raise daq_error(
                -200290, "The generation has stopped to prevent the regeneration of old samples."
            )

    def _advance(self, dt_s: float) -> None:
        if not self._started:
            return
        if "ai" in self._names[0]:
            self._samples += dt_s * self._rate_hz * self._card.ai_clock_runs
            return
        self._owed += dt_s * self._rate_hz
        due = int(self._owed + 1e-6)
        self._owed -= due
        played, self._queue = self._queue[:due], self._queue[due:]
        self._generated += len(played)
        self._dry = self._dry or due > len(played)
        if played:
            self._card.played_v += played
            self._card.ao_v = played[-1]


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Card:
    card = Card()
    fake = ModuleType("nidaqmx")
    fake.Task = type("Task", (Task,), {"card": card, "__slots__": ()})  # type: ignore[attr-defined]
    fake.constants, fake.errors = nidaqmx.constants, nidaqmx.errors  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "nidaqmx", fake)
    return card


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
def test_the_fake_takes_the_arguments_of_the_real_package_in_its_order(
    fake: Any, real: Any
) -> None:
    expected = list(inspect.signature(real).parameters)
    given = list(inspect.signature(fake).parameters)
    assert given == expected[: len(given)]


def test_the_fake_has_no_attribute_that_the_real_package_lacks() -> None:
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


def test_the_real_package_without_its_driver_says_what_to_install() -> None:
    for device in (NiAnalogInputs(NAMES, sample_rate_hz=1e3), NiDigitalOutput("Dev1/port0/line0")):
        with pytest.raises(DeviceDisconnected, match="NI-DAQmx driver is not installed") as caught:
            device.open()
        assert "install NI-DAQmx" in caught.value.hint


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    monkeypatch.setitem(sys.modules, "nidaqmx.constants", None)
    with pytest.raises(DeviceError) as caught:
        NiDigitalInput("Dev1/port0/line0").read()
    assert "haptic-driver[ni]" in caught.value.hint


def test_inputs_give_the_newest_samples_oldest_first(card: Card) -> None:
    card.signals["Dev1/ai1"] = lambda t: t
    inputs = inputs_on(card)
    inputs.open()
    card.advance(0.1)
    samples_v = inputs.latest_v(3)
    assert samples_v.tolist() == [[0.0, 0.097, 2.0], [0.0, 0.098, 2.0], [0.0, 0.099, 2.0]]
    assert inputs.columns(["Dev1/ai2", "Dev1/ai0"]).latest_v(1).tolist() == [[2.0, 0.0]]


def test_inputs_wait_for_the_first_samples_and_no_longer_than_the_timeout(card: Card) -> None:
    inputs = inputs_on(card)
    inputs.open()
    assert inputs.latest_v(20).shape == (20, 3)
    assert card.now_s == pytest.approx(0.02, abs=0.002)
    with pytest.raises(DeviceTimeout):
        inputs.latest_v(2000)  # two seconds away
    assert card.now_s == pytest.approx(0.22, abs=0.005)


def test_a_stopped_sample_clock_is_an_error_and_not_an_old_value(card: Card) -> None:
    inputs = inputs_on(card)
    inputs.open()
    card.advance(0.1)
    inputs.latest_v(5)
    card.ai_clock_runs = False
    card.advance(0.25)
    with pytest.raises(DeviceTimeout, match="has not sampled"):
        inputs.latest_v(5)


def test_a_clock_that_stopped_while_nobody_looked_is_noticed_at_the_first_look(card: Card) -> None:
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


def test_a_monitor_of_an_alternating_voltage_reads_its_peak(card: Card) -> None:
    card.signals["Dev1/ai2"] = lambda t: 1.5 * np.sin(2.0 * np.pi * 70.0 * t)
    inputs = inputs_on(card)
    inputs.open()
    peak = NiAnalogInput(inputs, "Dev1/ai2", window_s=0.1, peak=True)
    mean = NiAnalogInput(inputs, "Dev1/ai2", window_s=0.1, peak=False)
    assert peak.read_v() == pytest.approx(1.5, rel=0.03)
    assert mean.read_v() == pytest.approx(0.0, abs=1e-9)  # seven whole periods


def test_a_second_input_task_is_refused_by_the_card_in_its_own_words(card: Card) -> None:
    inputs_on(card).open()
    with pytest.raises(InstrumentRejected, match="-50103"):
        inputs_on(card).open()


def test_a_failed_opening_releases_its_task(card: Card) -> None:
    unknown = NiAnalogInputs(["Dev1/ai9"], sample_rate_hz=1e3)
    with pytest.raises(InstrumentRejected, match="-200170"):
        unknown.open()
    assert card.tasks == []


@pytest.mark.parametrize(
    "bad", [{"terminal": "DIFFERENTIAL"}, {"channels": []}, {"channels": ["a", "a"]}]
)
def test_impossible_inputs_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"terminal|channels"):
        NiAnalogInputs(**({"channels": NAMES, "sample_rate_hz": 1e3} | bad))


def test_closed_inputs_say_so(card: Card) -> None:
    inputs = inputs_on(card)
    inputs.open()
    inputs.close()
    inputs.close()
    assert card.tasks == []
    with pytest.raises(DeviceDisconnected):
        inputs.latest_v(1)


def test_the_lines_serve_an_amplifier(card: Card) -> None:
    inputs = inputs_on(card)
    inputs.open()
    card.signals["Dev1/ai2"] = lambda t: 1.2
    enable = NiDigitalOutput("Dev1/port0/line0")
    settings = AmplifierSettings(
        gain_v_per_v=100.0,
        voltage_limit_v=300.0,
        current_limit_a=0.01,
        slew_limit_v_per_s=10e6,
        voltage_monitor_v_per_v=0.01,
    )
    amplifier = AnalogAmplifier(
        settings, enable, NiAnalogInput(inputs, "Dev1/ai2", window_s=0.01, peak=True)
    )
    assert amplifier.enable() is AmplifierState.ENABLED
    assert card.lines["Dev1/port0/line0"] is True
    assert amplifier.monitor_voltage_v() == pytest.approx(120.0)
    assert amplifier.disable() is AmplifierState.DISABLED
    card.broken = True
    assert amplifier.disable() is AmplifierState.UNKNOWN
    assert amplifier.monitor_voltage_v() is None


def test_a_digital_input_reads_its_line(card: Card) -> None:
    line = NiDigitalInput("Dev1/port0/line1")
    assert line.read() is True
    card.lines["Dev1/port0/line1"] = False
    assert line.read() is False
    line.close()
    assert card.tasks == []


def test_opening_the_output_sets_the_zero_level_and_closing_leaves_it(card: Card) -> None:
    with output_on(card) as output:
        assert card.ao_v == -5.0
        output.hold(2.0)
        assert card.ao_v == 2.0
    assert card.ao_v == -5.0
    assert card.tasks == []


def test_a_stream_is_played_without_gap_or_repeat(card: Card) -> None:
    envelope_v = 4.0 * np.sin(np.linspace(0.0, 20.0, 5000))
    with output_on(card) as output:
        for block_v in np.split(envelope_v, 10):  # 10 ms blocks at 50 kS/s
            output.write(block_v, 50e3)
            if output.buffered_s > 0.02:
                card.advance(0.01)
        card.advance(0.02)
        assert card.played_v == envelope_v.tolist()
        assert output.buffered_s == pytest.approx(0.0, abs=1e-9)


def test_a_stream_that_runs_dry_goes_to_zero_and_is_reported_once(card: Card) -> None:
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


def test_a_stream_that_ends_at_the_zero_level_is_no_underrun(card: Card) -> None:
    with output_on(card) as output:
        output.write([2.0, 1.0, -5.0], 1e3)
        card.advance(0.02)
        output.check()
        assert output.level_v == card.ao_v == -5.0


def test_holding_and_zero_end_a_stream_at_once(card: Card) -> None:
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


def test_a_card_that_disappears_is_reported_as_not_known_to_be_at_zero(card: Card) -> None:
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


def test_a_rate_or_level_beyond_the_limits_never_reaches_the_card(card: Card) -> None:
    with output_on(card) as output:
        output.write(np.full(500, 3.0), 50e3)
        for block_v, rate_hz in (
            ([5.1], 50e3),
            ([np.nan], 50e3),
            ([0.0], 200e3),
            ([0.0], 40e3),
            (np.zeros(9999), 50e3),
        ):
            with pytest.raises(LimitExceeded):
                output.write(block_v, rate_hz)
        card.advance(0.005)
        assert card.ao_v == 3.0  # the stream goes on


def test_the_watch_thread_zeroes_a_dry_stream_by_itself(card: Card) -> None:
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
