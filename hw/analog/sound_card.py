"""A sound card as analog output, through sounddevice and PortAudio.

Almost every sound card is AC-coupled: a high-pass of some hertz stands before its socket. A held
level fades to nothing within a fraction of a second, and a streamed envelope loses its mean and
swings below its lowest sample. Such a card can carry only what has no slow part, as a carrier.
Level, coupling and polarity differ from card to card and with its volume control: measure them, at
the socket, with the volume fixed.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hw.analog.output import AnalogOutput, AnalogOutputSettings, Array
from hw.errors import DeviceDisconnected, DeviceError, InstrumentRejected, LimitExceeded
from hw.setting import Setting


def load_sounddevice() -> ModuleType:
    """Import sounddevice. Raises DeviceError naming what to install."""
    try:
        return import_module("sounddevice")
    except ImportError as error:
        raise DeviceError(
            f"sound cards need the Python package sounddevice ({error})",
            "pip install 'haptic-driver[sound]'",
        ) from error
    except OSError as error:  # raised by sounddevice itself
        raise DeviceError(
            f"sounddevice finds no PortAudio ({error})",
            "install the library: libportaudio2 on Debian and Ubuntu",
        ) from error


RATE_TOLERANCE = 1e-3  # of a crystal that is off; another rate of the card's is farther away
# Devices that are no card: a server or a mapper behind them chooses one, and mixes channels.
SERVERS = {"default", "sysdefault", "pulse", "pipewire", "jack", "dmix"}
SERVERS |= {"microsoft sound mapper - output", "primary sound driver"}
SERVER_APIS = ("jack", "pulseaudio", "pipewire")


class SoundSettings(NamedTuple):
    """`full_scale_v`: measured at the socket for a sample of 1.0; `dc_coupled`: whether a level
    stays.
    """

    sample_rate_hz: float
    full_scale_v: float
    dc_coupled: bool
    channel: int = 0
    latency_s: float = 0.02


def make_output(where: str, settings: AnalogOutputSettings) -> AnalogOutput:
    """`card:sound:DEVICE/CHANNEL`, by name or number, for what has no slow part; `/0` may be left
    out.

    Its full scale is `settings.high_v` at the socket.
    """
    device, _, channel = where.rpartition("/")
    if not (device and channel.isdecimal()):
        device, channel = where, "0"
    sound = SoundSettings(
        settings.sample_rate_limit_hz, settings.high_v, dc_coupled=False, channel=int(channel)
    )
    return SoundCardOutput(int(device) if device.isdecimal() else device, settings, sound)


class SoundCardOutput(AnalogOutput):
    """One channel of a sound card at a fixed sample rate; other channels stay silent.

    All channels of the device are opened, since a stream of fewer is played at sockets that nobody
    named. A sound server's device is refused: it has channels that no socket has. A card that takes
    no samples for as long as a gap may last is lost until it is opened again.

    Without DC coupling only 0 V can be held or be the zero level, and what is streamed arrives
    without its slow part. Rate and latency are those that the open stream got: a rate that
    is off by more than a share of RATE_TOLERANCE is refused.
    """

    def __init__(
        self,
        device: str | int | None,
        settings: AnalogOutputSettings,
        sound: SoundSettings,
        *,
        clock: Callable[[], float] = time.monotonic,
        watch: bool = True,
    ) -> None:
        super().__init__(
            f"sound card {'default' if device is None else device}",
            settings,
            clock=clock,
            watch=watch,
        )
        if not sound.full_scale_v >= max(abs(settings.low_v), abs(settings.high_v)):
            raise ValueError(
                f"{self.resource}: limits beyond its full scale of {sound.full_scale_v:g} V"
            )
        if not sound.dc_coupled and settings.zero_level_v != 0.0:
            raise ValueError(
                f"{self.resource} is AC-coupled and cannot rest at {settings.zero_level_v:g} V"
            )
        self._device = device
        self._sound = sound
        self._stream: Any = None
        self._queue_lock = threading.Lock()
        self._queue: deque[Array] = deque()
        self._rest_v = settings.zero_level_v
        self._late = False
        self._waiting_since_s: float | None = None
        self._stopped = False

    def hold(self, level_v: float) -> None:
        """Hold a level, as every analog output does; LimitExceeded for other than 0 V without DC
        coupling.
        """
        if level_v != 0.0 and not self._sound.dc_coupled:
            raise LimitExceeded(
                f"{self.resource} is AC-coupled and cannot hold {level_v:g} V",
                "use a DC-coupled output",
            )
        super().hold(level_v)

    def _check_rate(self, sample_rate_hz: float) -> None:
        super()._check_rate(sample_rate_hz)
        if sample_rate_hz != self._rate_got_hz(sample_rate_hz):
            raise LimitExceeded(
                f"{self.resource} plays at {self._rate_got_hz(sample_rate_hz):g} samples/s, not"
                f" {sample_rate_hz:g}",
                "write at its rate",
            )

    def _rate_got_hz(self, sample_rate_hz: float) -> float:
        return float(self._stream.samplerate)

    def read_back_v(self) -> float | None:
        """Nothing reads a socket; raises DeviceError where there is no such card."""
        if self._stream is None:
            with self._portaudio() as sounddevice:
                self._there(sounddevice)
        return None

    @property
    def latency_s(self) -> float:
        """That of the open stream."""
        return self._sound.latency_s if self._stream is None else float(self._stream.latency)

    def held(self) -> list[Setting]:
        """Rate, latency and channels of the open stream."""
        if self._stream is None:
            return []
        sound = self._sound
        return [
            Setting("sample_rate_hz", sound.sample_rate_hz, float(self._stream.samplerate)),
            Setting("latency_s", sound.latency_s, self.latency_s),
        ]

    def _connect(self) -> None:
        with self._portaudio() as sounddevice:
            there = self._there(sounddevice)
            stream = sounddevice.OutputStream(
                samplerate=self._sound.sample_rate_hz,
                device=self._device,
                channels=there,
                dtype="float32",
                latency=self._sound.latency_s,
                callback=self._play,
            )
            self._stream = stream
            self._stopped, self._waiting_since_s = False, None
            asked_hz, got_hz = self._sound.sample_rate_hz, float(stream.samplerate)
            if abs(got_hz - asked_hz) > RATE_TOLERANCE * asked_hz:
                raise InstrumentRejected(
                    f"{self.resource} plays at {got_hz:g} samples/s where {asked_hz:g} were asked",
                    "write down a rate that the card has",
                )
            stream.start()

    def _there(self, sounddevice: ModuleType) -> int:
        """How many channels the card has; InstrumentRejected where one is not its."""
        about = sounddevice.query_devices(self._device, "output")
        self._refuse_server(sounddevice, about)
        there = int(about["max_output_channels"])
        if self._sound.channel >= there:
            raise InstrumentRejected(
                f"{self.resource} has {there} output channels, and channel {self._sound.channel}"
                " was asked for",
                "channels count from 0",
            )
        return there

    def _refuse_server(self, sounddevice: ModuleType, about: Mapping[str, Any]) -> None:
        """Raise InstrumentRejected for a device behind which others choose the card."""
        names = {str(about["name"]).casefold(), str(self._device or "").casefold()}
        is_server = any(each in SERVERS for each in names)
        if not is_server and "hostapi" in about:
            api = str(sounddevice.query_hostapis(about["hostapi"])["name"])
            is_server = api.casefold().startswith(SERVER_APIS)
        if is_server:
            raise InstrumentRejected(
                f"{self.resource} ({about['name']}) is no card but a sound server's device: which"
                " socket plays its channels, nobody knows",
                "name the card, as python -m sounddevice lists it, such as hw:1,0",
            )

    def _disconnect(self) -> None:
        if self._stream is not None:
            with suppress(Exception):
                self._stream.abort()  # stop() would wait for what is buffered
            with suppress(Exception):
                self._stream.close()
            self._stream = None

    def _set_level(self, level_v: float) -> None:
        with self._queue_lock:
            self._queue.clear()
            self._rest_v = level_v
            self._late = False
            self._wait()
        self._check_running()

    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        with self._queue_lock:
            self._late = False
        self._append(block_v)

    def _append(self, block_v: Array) -> None:
        self._check_running()
        with self._queue_lock:
            self._queue.append(block_v)
            self._wait()

    def _wait(self) -> None:
        """Something is to be taken by the card from now on."""
        if self._waiting_since_s is None:
            self._waiting_since_s = self._clock()

    def _buffered_samples(self) -> int:
        self._check_running()
        with self._queue_lock:
            return 0 if self._late else sum(block_v.size for block_v in self._queue)

    def _check_running(self) -> None:
        since_s = self._waiting_since_s
        if since_s is not None and self._clock() - since_s > self.settings.gap_s + self.latency_s:
            self._stopped = True
        if self._stopped:
            raise DeviceDisconnected(
                f"{self.resource} takes no samples", "check that it is plugged in, and reopen it"
            )
        with self._portaudio():
            if self._stream is None or not self._stream.active:
                raise DeviceDisconnected(
                    f"{self.resource} has stopped", "check that it is plugged in, and reopen it"
                )

    def _play(self, outdata: NDArray[np.float32], frames: int, time_info: Any, status: Any) -> None:
        """PortAudio's callback: the queue, then the resting level. Runs on PortAudio's thread."""
        with self._queue_lock:
            if status.output_underflow and self._queue:
                self._late = True
                self._queue.clear()
            self._waiting_since_s = None
            samples_v = np.full(frames, self._rest_v)
            filled = 0
            while filled < frames and self._queue:
                block_v = self._queue.popleft()
                taken = min(block_v.size, frames - filled)
                samples_v[filled : filled + taken] = block_v[:taken]
                filled += taken
                if taken < block_v.size:
                    self._queue.appendleft(block_v[taken:])
            if filled:
                self._rest_v = float(samples_v[filled - 1])  # where it stays when it runs dry
                samples_v[filled:] = self._rest_v
            if self._queue:
                self._wait()
        outdata.fill(0.0)
        outdata[:, self._sound.channel] = samples_v / self._sound.full_scale_v

    @contextmanager
    def _portaudio(self) -> Iterator[Any]:
        sounddevice = load_sounddevice()
        try:
            yield sounddevice
        except (sounddevice.PortAudioError, ValueError) as error:  # ValueError: no such device
            raise InstrumentRejected(
                f"{self.resource}: {error}", "list devices with python -m sounddevice"
            ) from error
