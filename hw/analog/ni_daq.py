"""National Instruments cards through nidaqmx: analog inputs, digital lines, a hardware-timed analog
output.

Names are NI-DAQmx's: "Dev1/ai0", "Dev1/port0/line0", "Dev1/ao0". Facts about tasks, buffers and
markers are from the nidaqmx 1.7.0 package's own documentation; nothing here was run on a card.
"""

from __future__ import annotations

import re
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from math import ceil
from types import ModuleType
from typing import Any

import numpy as np

from hw.analog.lines import AnalogInputs
from hw.analog.output import AnalogOutput, AnalogOutputSettings, Array, CardReserved, OutputUnderrun
from hw.errors import DeviceDisconnected, DeviceError, DeviceTimeout, InstrumentRejected
from hw.setting import Setting, refuse_unlike

TERMINALS = ("DIFF", "RSE", "NRSE", "PSEUDO_DIFF", "DEFAULT")
_NOT_IN_TIME = {
    -200284,
    -200292,
    -200293,
}  # samples not yet available, not yet writable, no more space
_TOO_FAST = {-200361, -200279}  # its memory, or the driver's buffer, ran over
_RAN_DRY = {
    -200290,
    -200291,
    -200621,
    -200018,
    -200016,
}  # no regeneration; buffer, FIFO and DAC underflow
_RESERVED = {-50103, -200022}
_POLL_S = 1e-3
_LINE_TIMEOUT_S = 0.5
_READ_BACK = 50  # single looks, at no multiple of a carrier's period
_AS_THE_CARD_SAYS = "write down in the rig's file what the card makes of it"
_RATE_SHORTFALL = 0.01  # the highest carrier, NYQUIST_SHARE of the rate, leaves more room than that
_INTERVAL_TOLERANCE = 0.01  # of a conversion's interval: below a hundredth of a sample's phase


def load_nidaqmx() -> ModuleType:
    """Import nidaqmx. Raises DeviceError naming the extra to install."""
    try:
        for name in ("nidaqmx.constants", "nidaqmx.errors", "nidaqmx.system"):
            import_module(name)
        return import_module("nidaqmx")
    except ImportError as error:
        raise DeviceError(
            f"NI cards need the Python package nidaqmx ({error})", "pip install 'haptic-driver[ni]'"
        ) from error


@contextmanager
def _daqmx(resource: str) -> Iterator[Any]:
    """Give nidaqmx; its errors leave as DeviceError with the card's own words and number."""
    nidaqmx = load_nidaqmx()
    try:
        yield nidaqmx
    except (nidaqmx.errors.DaqNotFoundError, nidaqmx.errors.DaqNotSupportedError) as error:
        raise DeviceDisconnected(
            f"{resource}: the NI-DAQmx driver is not installed on this machine",
            "install NI-DAQmx for this operating system; recent versions have dropped old cards"
            " such as the E Series",
        ) from error
    except nidaqmx.errors.DaqError as error:
        message = " ".join(str(error).split())
        if error.error_code in _RAN_DRY:
            raise OutputUnderrun(
                f"{resource} ran out of samples ({message})", "write sooner"
            ) from error
        if error.error_code in _RESERVED:
            raise CardReserved(
                f"{resource} is used by another program ({message})", "end it; or reset the card"
            ) from error
        if error.error_code in _NOT_IN_TIME:
            raise DeviceTimeout(
                f"{resource} was not ready in time ({message})", "check the card's clock"
            ) from error
        hint = "compare the rig's file with NI MAX"
        if error.error_code in _TOO_FAST:
            hint = "give a lower sample rate, or the machine less to do"
        raise InstrumentRejected(f"{resource}: {message}", hint) from error
    except nidaqmx.errors.Error as error:
        raise DeviceError(f"{resource}: {error}", "update NI-DAQmx") from error


def _clear(task: Any) -> None:
    """Release a task, whatever state it is in."""
    with suppress(Exception):
        task.close()


class NiAnalogInputs:
    """Several inputs of one card, sampled together and for ever; readers take the newest samples.

    One task for all of them, since a card has one clock for its inputs: a second task would be
    refused. Six gauges in DIFF leave two of eight channels for monitors. The channels share one
    converter, so they are skewed by up to a sample. `terminal` is of all channels, or each its own.
    A card divides its time base by whole numbers, so it reaches few rates exactly. Once open,
    `sample_rate_hz` and `buffer_s` are what the card really uses. A slower clock, a narrower range
    and another terminal are refused. Thread-safe.
    """

    def __init__(
        self,
        channels: Sequence[str],
        *,
        sample_rate_hz: float,
        range_v: float = 10.0,
        terminal: str | Mapping[str, str] = "DIFF",
        buffer_s: float = 2.0,
        timeout_s: float = 0.5,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not channels or len(set(channels)) != len(channels):
            raise ValueError(f"channels must be given, each once, not {list(channels)}")
        each = dict.fromkeys(channels, terminal) if isinstance(terminal, str) else dict(terminal)
        if set(each) != set(channels) or not set(each.values()) <= set(TERMINALS):
            raise ValueError(f"terminal must be one of {', '.join(TERMINALS)}, not {terminal!r}")
        self.resource = ", ".join(channels)
        self._channels = tuple(channels)
        self._asked_rate_hz, self._asked_buffer_s = sample_rate_hz, buffer_s
        self.sample_rate_hz, self.buffer_s = sample_rate_hz, buffer_s
        self.conversion_interval_s: float | None = None
        self._range_v = range_v
        self._terminals = each
        self._buffer_samples = max(2, round(buffer_s * sample_rate_hz))
        self._held: list[Setting] = []
        self._timeout_s = timeout_s
        self._clock = clock
        self._sleep = sleep
        self._lock = threading.Lock()
        self._task: Any = None
        self._acquired = 0
        self._advanced_s = -float("inf")

    def open(self) -> None:
        """Start sampling; does nothing when open. Raises DeviceError."""
        with self._lock, _daqmx(self.resource) as nidaqmx:
            if self._task is not None:
                return
            constants = nidaqmx.constants
            task = nidaqmx.Task()
            try:
                made = [
                    task.ai_channels.add_ai_voltage_chan(
                        channel,
                        terminal_config=constants.TerminalConfiguration[self._terminals[channel]],
                        min_val=-self._range_v,
                        max_val=self._range_v,
                    )
                    for channel in self._channels
                ]
                task.timing.cfg_samp_clk_timing(
                    self._asked_rate_hz,
                    sample_mode=constants.AcquisitionType.CONTINUOUS,
                    samps_per_chan=max(2, round(self._asked_buffer_s * self._asked_rate_hz)),
                )
                task.in_stream.overwrite = constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
                task.in_stream.relative_to = constants.ReadRelativeTo.MOST_RECENT_SAMPLE
                self._read_back(task, made, nidaqmx)
                task.start()
            except BaseException:
                _clear(task)
                raise
            self._task, self._acquired, self._advanced_s = task, 0, self._clock()

    def held(self) -> list[Setting]:
        """What was asked of the card and what it got, at the last opening."""
        return list(self._held)

    def _read_back(self, task: Any, made: Sequence[Any], nidaqmx: Any) -> None:
        """What the card makes of what it was asked; InstrumentRejected for what numbers cannot take
        in.
        """
        rate_hz = float(task.timing.samp_clk_rate)
        samples = int(task.in_stream.input_buf_size)
        terminals, ranges = [], []
        for name, channel in zip(self._channels, made, strict=True):
            asked, got = self._terminals[name], channel.ai_term_cfg.name
            terminals.append(Setting(f"terminal of {name}", asked, got))
            reach_v = min(float(channel.ai_rng_high), -float(channel.ai_rng_low))
            ranges.append(Setting(f"range_v of {name}", self._range_v, reach_v))
        self._held = [
            Setting("sample_rate_hz", self._asked_rate_hz, rate_hz),
            Setting("buffer_s", self._asked_buffer_s, samples / rate_hz),
            *terminals,
            *ranges,
        ]
        unlike = [one for one in terminals if one.asked != "DEFAULT"]
        unlike += [one for one in ranges if one.got < self._range_v]  # type: ignore[operator]
        if rate_hz < self._asked_rate_hz * (1.0 - _RATE_SHORTFALL):
            unlike.append(self._held[0])
        refuse_unlike(self.resource, unlike, _AS_THE_CARD_SAYS)
        self.sample_rate_hz, self._buffer_samples = rate_hz, samples
        self.buffer_s = samples / rate_hz
        try:
            self.conversion_interval_s = 1.0 / float(task.timing.ai_conv_rate)
        except nidaqmx.errors.DaqError:  # one converter per channel: all at once
            self.conversion_interval_s = None

    def close(self) -> None:
        """Stop sampling; never fails, does nothing when closed."""
        with self._lock:
            if self._task is not None:
                _clear(self._task)
                self._task = None

    def latest_v(self, count: int) -> Array:
        """Return the newest `count` samples of all channels, shape (count, channels), V, oldest
        first.

        Raises DeviceTimeout when the card has not sampled for `timeout_s`, however many old samples
        it holds. Raises DeviceDisconnected when not open, and ValueError for more samples than the
        buffer keeps.
        """
        if not 1 <= count <= self._buffer_samples:
            raise ValueError(f"count must be 1..{self._buffer_samples}, not {count}")
        with self._lock:
            if self._task is None:
                raise DeviceDisconnected(f"{self.resource}: not open", "call open() first")
            with _daqmx(self.resource):
                self._wait_for(count)
                self._task.in_stream.offset = -count
                data = self._task.read(number_of_samples_per_channel=count, timeout=self._timeout_s)
        samples_v = np.asarray(data, dtype=np.float64).reshape(len(self._channels), -1)
        if samples_v.shape[1] != count:
            raise DeviceTimeout(
                f"{self.resource} gave {samples_v.shape[1]} of {count} samples", "check its clock"
            )
        return samples_v.T

    def columns(self, channels: Sequence[str], conversion_interval_s: float = 0.0) -> NiColumns:
        """Some of the channels by name, e.g. a sensor's gauges. Raises ValueError for one that is
        not sampled.

        `conversion_interval_s`: from one channel to the next, where the card does not say it.
        """
        return NiColumns(self, self.places(channels), conversion_interval_s)

    def places(self, channels: Sequence[str]) -> list[int]:
        """Where channels stand in the order of conversion. Raises ValueError for one that is not
        sampled.
        """
        missing = [channel for channel in channels if channel not in self._channels]
        if missing:
            raise ValueError(
                f"{', '.join(missing)} not among the sampled channels {', '.join(self._channels)}"
            )
        return [self._channels.index(channel) for channel in channels]

    def _wait_for(self, count: int) -> None:
        """Wait until `count` samples are there and the card has sampled since the last look, or
        within `timeout_s`.
        """
        deadline_s = self._clock() + self._timeout_s
        # or nobody looked: what is there may be old
        stalled = self._clock() - self._advanced_s > self._timeout_s
        first = total = int(self._task.in_stream.total_samp_per_chan_acquired)
        while total < count or (stalled and total == first):
            if self._clock() >= deadline_s:
                raise DeviceTimeout(
                    f"{self.resource} has not sampled for {self._timeout_s:g} s ({total} samples so"
                    " far)",
                    "check the card's clock and power; then reopen it",
                )
            self._sleep(_POLL_S)
            total = int(self._task.in_stream.total_samp_per_chan_acquired)
        if total != self._acquired:
            self._acquired, self._advanced_s = total, self._clock()


class NiColumns:
    """Some channels of a NiAnalogInputs."""

    def __init__(
        self, inputs: NiAnalogInputs, columns: Sequence[int], conversion_interval_s: float = 0.0
    ) -> None:
        self._inputs = inputs
        self._columns = list(columns)
        self._asked_interval_s = conversion_interval_s

    @property
    def sample_rate_hz(self) -> float:
        """The card's, as it got it."""
        return self._inputs.sample_rate_hz

    @property
    def buffer_s(self) -> float:
        """How far back the card remembers."""
        return self._inputs.buffer_s

    @property
    def lags_s(self) -> Sequence[float]:
        """How much later than the card's first channel each is sampled.

        Raises InstrumentRejected where the card says otherwise than the rig's file.
        """
        asked_s, got_s = self._asked_interval_s, self._inputs.conversion_interval_s
        if asked_s and got_s and abs(got_s - asked_s) > _INTERVAL_TOLERANCE * asked_s:
            unlike = Setting("conversion_interval_s", asked_s, got_s)
            refuse_unlike(self._inputs.resource, [unlike], _AS_THE_CARD_SAYS)
        return [place * (got_s or asked_s) for place in self._columns]

    def latest_v(self, count: int) -> Array:
        """Return the newest `count` samples, shape (count, channels), V. Raises DeviceError."""
        return self._inputs.latest_v(count)[:, self._columns]


class NiCards:
    """The inputs of one or several cards, each with a task and a clock of its own.

    What is compared in time, such as two monitors, must be on one card.
    """

    def __init__(self, cards: Sequence[NiAnalogInputs]) -> None:
        self._cards = tuple(cards)
        self.resource = "; ".join(card.resource for card in cards)

    def open(self) -> None:
        """Start sampling on every card. Raises DeviceError, with none left sampling."""
        try:
            for card in self._cards:
                card.open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop sampling; never fails."""
        for card in self._cards:
            card.close()

    def held(self) -> list[Setting]:
        """Asked and got, card by card."""
        held = []
        for card in self._cards:
            where = f" of {card_of(card.resource)}" if len(self._cards) > 1 else ""
            held += [
                setting if " of " in setting.name else setting._replace(name=setting.name + where)
                for setting in card.held()
            ]
        return held

    def card(self, channels: Sequence[str]) -> NiAnalogInputs:
        """The card that samples all of these channels; ValueError where none does."""
        for card in self._cards:
            with suppress(ValueError):
                card.places(channels)
                return card
        raise ValueError(f"{', '.join(channels)} are not sampled by one card: {self.resource}")

    def columns(self, channels: Sequence[str], conversion_interval_s: float = 0.0) -> NiColumns:
        """Channels of one card. Raises ValueError as `card`."""
        return self.card(channels).columns(channels, conversion_interval_s)

    def latest_v(self, count: int) -> Array:
        """The newest samples of the only card. ValueError where there are several."""
        (card,) = self._cards
        return card.latest_v(count)


def card_of(channel: str) -> str:
    """The card of a channel: `Dev1` of `Dev1/ai0`."""
    return channel.partition("/")[0]


class NiAnalogInput:
    """One channel as an analog input: the mean of its newest `window_s`, or with `peak` the largest
    magnitude.

    A monitor of an alternating voltage needs `peak` over at least a period of the carrier: its mean
    is zero whatever the voltage is.
    """

    def __init__(self, inputs: AnalogInputs, channel: str, *, window_s: float, peak: bool) -> None:
        self._column = inputs.columns([channel])
        self._window_s = window_s
        self._peak = peak

    def read_v(self) -> float:
        """Return the voltage at the input, V. Raises DeviceError."""
        count = max(1, ceil(self._window_s * self._column.sample_rate_hz - 1e-6))
        samples_v = self._column.latest_v(count)
        return float(np.abs(samples_v).max() if self._peak else samples_v.mean())


class _NiLine(ABC):
    """One digital line, taken by `open` or the first use."""

    def __init__(self, line: str) -> None:
        self.resource = line
        self._lock = threading.Lock()
        self._task: Any = None

    def open(self) -> None:
        """Take the line; does nothing when taken. Raises DeviceError."""
        with self._taken():
            pass

    def read(self) -> bool:
        """Return the level that is on the line. Raises DeviceError."""
        with self._taken() as task:
            return bool(task.read(timeout=_LINE_TIMEOUT_S))

    def close(self) -> None:
        """Release the line, which keeps its level; never fails."""
        with self._lock:
            if self._task is not None:
                _clear(self._task)
                self._task = None

    @contextmanager
    def _taken(self) -> Iterator[Any]:
        with self._lock, _daqmx(self.resource) as nidaqmx:
            if self._task is None:
                task = nidaqmx.Task()
                try:
                    self._add(task)
                except BaseException:
                    _clear(task)
                    raise
                self._task = task
            yield self._task

    @abstractmethod
    def _add(self, task: Any) -> None:
        """Add the line to a new task."""


class NiDigitalInput(_NiLine):
    """One digital input, such as a fault line."""

    def _add(self, task: Any) -> None:
        task.di_channels.add_di_chan(self.resource)


class NiLineIn(NiDigitalInput):
    """One digital input as a line in: its level when the driver's call reaches the card."""

    def levels(self) -> Sequence[bool]:
        """Raises DeviceError."""
        return (self.read(),)


class NiDigitalOutput(_NiLine):
    """One digital output, such as an enable line; what is read back is the card's port, not the far
    end of the wire.
    """

    def write(self, value: bool, /) -> None:
        """Set the line. Raises DeviceError."""
        with self._taken() as task:
            task.write(bool(value), auto_start=True, timeout=_LINE_TIMEOUT_S)

    def _add(self, task: Any) -> None:
        task.do_channels.add_do_chan(self.resource)


class NiEventLine(_NiLine):
    """Up to eight digital outputs of one port, such as "Dev1/port0/line0:7", that are set at once.

    Edges come when the driver's call reaches the card: they follow no sample clock.
    """

    def open(self) -> None:
        """Take the lines, and set them low. Raises DeviceError."""
        self.put(0)

    def put(self, code: int) -> None:
        """Set the lines, the first by bit 0. Raises DeviceError."""
        with self._taken() as task:
            value = code if _is_range(self.resource) else code != 0
            task.write(value, auto_start=True, timeout=_LINE_TIMEOUT_S)

    def close(self) -> None:
        """Lines low, if the card still listens, and released; never fails."""
        with suppress(DeviceError):
            self.put(0)
        super().close()

    def _add(self, task: Any) -> None:
        grouping = load_nidaqmx().constants.LineGrouping.CHAN_FOR_ALL_LINES
        task.do_channels.add_do_chan(self.resource, line_grouping=grouping)


def _is_range(lines: str) -> bool:
    """Whether a name means several lines: nidaqmx takes numbers for these, and bool for one."""
    return not re.fullmatch(r".+/line\d+", lines, re.IGNORECASE)


class NiAnalogOutput(AnalogOutput):
    """One output of a card, streamed by its sample clock without repeating old samples.

    A card keeps its last sample when a stream runs dry, and its last level when the process dies.
    The watch thread sets zero in the first case. Nothing here can act in the second.
    """

    def __init__(
        self,
        channel: str,
        settings: AnalogOutputSettings,
        *,
        clock: Callable[[], float] = time.monotonic,
        watch: bool = True,
    ) -> None:
        super().__init__(channel, settings, clock=clock, watch=watch)
        self._task: Any = None
        self._written: int | None = None  # samples of the stream; None when the task holds a level

    def _connect(self) -> None:
        with _daqmx(self.resource) as nidaqmx:
            self._task = self._new_task(nidaqmx)

    def _disconnect(self) -> None:
        if self._task is not None:
            _clear(self._task)
        self._task, self._written = None, None

    def read_back_v(self) -> float | None:
        """By the channel inside the card from its output to its converter, where it has one."""
        with _daqmx(self.resource) as nidaqmx:
            device, _, name = self.resource.partition("/")
            task = nidaqmx.Task()
            try:
                task.ai_channels.add_ai_voltage_chan(
                    f"{device}/_{name}_vs_aognd",
                    min_val=self.settings.low_v,
                    max_val=self.settings.high_v,
                )
                looks_v = [abs(float(task.read())) for _ in range(_READ_BACK)]
            except nidaqmx.errors.DaqError:  # no such channel, or its converter is in use
                return None
            finally:
                _clear(task)
        return max(looks_v)

    def reset(self) -> None:
        """NI-DAQmx aborts all tasks of the card, by its documentation, also those of other programs
        (unverified).
        """
        with _daqmx(self.resource) as nidaqmx:
            nidaqmx.system.Device(card_of(self.resource)).reset_device()

    def _set_level(self, level_v: float) -> None:
        with _daqmx(self.resource) as nidaqmx:
            if self._written is not None or self._task is None:
                self._disconnect()
                self._task = self._new_task(nidaqmx)
            try:
                self._task.write(level_v, auto_start=True, timeout=self.settings.timeout_s)
            except BaseException:
                self._disconnect()  # so that the next attempt begins with a fresh task
                raise

    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        with _daqmx(self.resource) as nidaqmx:
            self._disconnect()
            task = self._task = self._new_task(nidaqmx)
            self._written = 0
            buffer_samples = max(2, int(np.ceil(self.settings.buffer_s * sample_rate_hz)))
            task.timing.cfg_samp_clk_timing(
                sample_rate_hz,
                sample_mode=nidaqmx.constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=buffer_samples,
            )
            got_hz = float(task.timing.samp_clk_rate)
            refuse_unlike(
                self.resource,
                [Setting("sample_rate_hz", sample_rate_hz, got_hz)],
                "write at the rate of `plays_at`",
            )
            task.out_stream.regen_mode = nidaqmx.constants.RegenerationMode.DONT_ALLOW_REGENERATION
            task.out_stream.output_buf_size = buffer_samples
            self._append(block_v)
            task.start()

    def _rate_got_hz(self, sample_rate_hz: float) -> float:
        """A task that is set up and never started: the card's own clock is divided, not set."""
        with _daqmx(self.resource) as nidaqmx:
            task = self._new_task(nidaqmx)
            try:
                task.timing.cfg_samp_clk_timing(
                    sample_rate_hz,
                    sample_mode=nidaqmx.constants.AcquisitionType.CONTINUOUS,
                    samps_per_chan=2,
                )
                return float(task.timing.samp_clk_rate)
            finally:
                _clear(task)

    def _append(self, block_v: Array) -> None:
        with _daqmx(self.resource):
            self._task.write(block_v, auto_start=False, timeout=self.settings.timeout_s)
            self._written = (self._written or 0) + block_v.size

    def _buffered_samples(self) -> int:
        try:
            with _daqmx(self.resource):
                return max(
                    0,
                    (self._written or 0) - int(self._task.out_stream.total_samp_per_chan_generated),
                )
        except OutputUnderrun:
            return 0

    def _new_task(self, nidaqmx: Any) -> Any:
        task = nidaqmx.Task()
        try:
            task.ao_channels.add_ao_voltage_chan(
                self.resource, min_val=self.settings.low_v, max_val=self.settings.high_v
            )
        except BaseException:
            _clear(task)
            raise
        return task


def make_output(where: str, settings: AnalogOutputSettings) -> AnalogOutput:
    """`card:ni:Dev1/ao0`."""
    return NiAnalogOutput(where, settings)
