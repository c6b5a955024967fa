"""What is used of sounddevice, with one device behind it."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest


class PortAudioError(Exception):
    pass


class OutputStream:
    """What is used of sounddevice.OutputStream; `pull` is what PortAudio's thread does."""

    __slots__ = ("_callback", "_channels", "device", "latency", "samplerate", "state")
    devices: tuple[str, ...] = ("DAC",)
    host_api = "ALSA"
    channels_there = (2,)  # how many a stream may be opened with
    got_rate_hz, got_latency_s = 48e3, 0.02
    newest: OutputStream

    def __init__(
        self,
        samplerate: float,
        device: Any,
        channels: int,
        dtype: str,
        latency: float,
        callback: Any,
    ) -> None:
        assert dtype == "float32"
        assert samplerate == 48e3
        if device not in self.devices:
            raise ValueError(f"No output device matching {device!r}")
        if channels not in self.channels_there:
            raise PortAudioError("Invalid number of channels", -9998)
        self._callback, self._channels, self.state = callback, channels, "new"
        self.device = device
        self.samplerate, self.latency = self.got_rate_hz, self.got_latency_s
        OutputStream.newest = self

    @property
    def active(self) -> bool:
        return self.state == "started"

    def start(self) -> None:
        self.state = "started"

    def abort(self) -> None:
        self.state = "aborted"

    def close(self) -> None:
        assert self.state == "aborted"
        self.state = "closed"

    def pull(self, frames: int, *, underflow: bool = False) -> np.ndarray[Any, Any]:
        out = np.full((frames, self._channels), np.nan, dtype=np.float32)
        self._callback(out, frames, None, SimpleNamespace(output_underflow=underflow))
        return out


def query_devices(device: Any = None, kind: str | None = None) -> dict[str, Any]:
    if device not in (None, *OutputStream.devices):
        raise ValueError(f"No output device matching {device!r}")
    assert kind == "output"
    name = OutputStream.devices[0] if device is None else device
    channels = OutputStream.channels_there[-1]
    return {"name": name, "max_output_channels": channels, "hostapi": 0}


def query_hostapis(index: int) -> dict[str, Any]:
    assert index == 0
    return {"name": OutputStream.host_api}


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever imports sounddevice finds this one."""
    fake = ModuleType("sounddevice")
    fake.OutputStream, fake.PortAudioError = OutputStream, PortAudioError  # type: ignore[attr-defined]
    fake.query_devices = query_devices  # type: ignore[attr-defined]
    fake.query_hostapis = query_hostapis  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "sounddevice", fake)
