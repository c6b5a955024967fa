"""A fake nidaqmx that knows only what the package documents, with its real constants and errors.

Rates are divided from a time base and ranges widened, as NI's documentation says of its cards.
"""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import nidaqmx.constants
import nidaqmx.errors
import numpy as np
import pytest

constants = nidaqmx.constants
NAMES = ("Dev1/ai0", "Dev1/ai1", "Dev1/ai2")


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
        self.lines: dict[str, int] = {"Dev1/port0/line0": False, "Dev1/port0/line1": True}
        self.lines["Dev1/port0/line0:7"] = 5  # left from before
        self.ao_v = 3.0  # left from before
        self.played_v: list[float] = []
        self.owners: dict[str, Any] = {}
        self.tasks: list[Any] = []
        self.broken = False
        self.fault = -88709, "The specified device is not present or is not active in the system."
        self.timebase_hz = 20e6
        self.ranges_v = (0.1, 1.0, 5.0, 10.0)
        self.terminals: dict[str, Any] = {}  # what the card makes of one that was asked for
        self.convert_rate_hz: float | None = None
        self.most_samples = 1 << 24  # of a buffer

    def advance(self, dt_s: float) -> None:
        self.now_s += dt_s
        for task in self.tasks:
            task._advance(dt_s)

    def check(self) -> None:
        if self.broken:
            raise daq_error(*self.fault)

    def reserve(self, resource: str, task: Any) -> None:
        self.check()
        if self.owners.setdefault(resource, task) is not task:
            raise daq_error(-50103, "The specified resource is reserved.")

    def reset(self) -> None:
        """As NI's documentation says of `reset_device`: all tasks are aborted; 0 V at the output.

        That it aborts those of other processes is not verified.
        """
        self.check()
        self.owners.clear()
        for task in self.tasks:
            task._started, task._aborted = False, True
        self.ao_v = 0.0


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

    def add_do_chan(
        self,
        lines: str,
        name_to_assign_to_lines: str = "",
        line_grouping: Any = constants.LineGrouping.CHAN_FOR_ALL_LINES,
    ) -> None:
        assert line_grouping is constants.LineGrouping.CHAN_FOR_ALL_LINES
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
        self._task._buffer = min(samps_per_chan, self._task._card.most_samples)

    def _divided(self, rate_hz: float) -> float:
        """As NI's knowledge base says: inputs round the divisor down, outputs to the nearest."""
        divisor = self._task._card.timebase_hz / rate_hz
        whole = np.floor(divisor + 1e-9) if "ai" in self._task._names[0] else np.round(divisor)
        return float(self._task._card.timebase_hz / max(whole, 1.0))

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
        "_aborted",
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
        self._started = self._dry = self._closed = self._aborted = False
        self.ai_channels, self.ao_channels = AIChannels(self), AOChannels(self)
        self.di_channels, self.do_channels = DIChannels(self), DOChannels(self)
        self.in_stream, self.out_stream, self.timing = (
            InStreamFake(self),
            OutStreamFake(self),
            Timing(self),
        )
        self._card.tasks.append(self)

    def start(self) -> None:
        self._card.reserve(
            f"{self._names[0][:4]} ai clock" if "ai" in self._names[0] else self._names[0], self
        )
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
        if count is None:  # a single look, without a clock
            return float(self._card.signals[self._names[0]](self._card.now_s))
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
            assert isinstance(data, int)
            # nidaqmx takes bool for a channel of one line, whole numbers for one of several
            assert isinstance(data, bool) is (":" not in self._names[0])
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
        if self._aborted:
            raise daq_error(-88710, "The task was aborted.")
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


def install(monkeypatch: pytest.MonkeyPatch) -> Card:
    """A card that whoever imports nidaqmx finds."""
    card = Card()
    fake = ModuleType("nidaqmx")
    fake.Task = type("Task", (Task,), {"card": card, "__slots__": ()})  # type: ignore[attr-defined]
    fake.system = SimpleNamespace(  # type: ignore[attr-defined]
        Device=lambda name: SimpleNamespace(reset_device=card.reset)
    )
    fake.constants, fake.errors = nidaqmx.constants, nidaqmx.errors  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "nidaqmx", fake)
    return card
