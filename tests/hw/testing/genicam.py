"""What is used of harvesters.core, with one camera behind it that does what it can."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

FEATURES = (
    *("PixelFormat", "ExposureAuto", "GainAuto", "AcquisitionMode", "AcquisitionFrameCount"),
    *("AcquisitionFrameRateEnable", "AcquisitionFrameRate", "ExposureTime"),
    *("TriggerSelector", "TriggerSource", "TriggerMode"),
)
WIDTH, HEIGHT = 40, 30


class Feature:
    """Holds what `makes` makes of what is set; `refuses` raises instead."""

    def __init__(self, makes: Callable[[Any], Any] = lambda value: value) -> None:
        self._makes, self._value = makes, None

    @property
    def value(self) -> Any:
        return self._value

    @value.setter
    def value(self, value: Any) -> None:
        self._value = self._makes(value)

    def execute(self) -> None:
        """As TriggerSoftware is."""


class Buffer:
    """A frame; each of `camera`'s lists tells of its frames by number."""

    def __init__(self, camera: GenicamDevice, number: int) -> None:
        self._camera, self._number = camera, number
        height = 0 if number in camera.empty else HEIGHT
        part = SimpleNamespace(
            data=camera.data(number)[: height * WIDTH * 2],
            width=WIDTH,
            height=height,
            data_format=camera.sends,
        )
        self.payload = SimpleNamespace(components=[part if camera.sends else None])
        self.timestamp, self.timestamp_frequency = 5_000_000 + 250_000 * number, 10_000_000

    def is_complete(self) -> bool:
        return self._number not in self._camera.incomplete

    @property
    def timestamp_ns(self) -> int:
        if not self._camera.in_nanoseconds:
            raise RuntimeError("GenTL exception: Resource or information is not available.")
        return 7_000 + 20_000_000 * self._number


class GenicamDevice:
    """A camera, and harvesters' acquirer for it."""

    def __init__(self) -> None:
        self.features = {name: Feature() for name in FEATURES}
        self.sends: str | None = "Mono8"
        self.incomplete: set[int] = set()
        self.empty: set[int] = set()
        self.in_nanoseconds = True
        self.frames_there = 1000
        self.padding = 0
        self.num_buffers = 0
        self._next = 0
        self._on = False

    @property
    def remote_device(self) -> SimpleNamespace:
        nodes = SimpleNamespace(**self.features, TriggerSoftware=Feature())
        return SimpleNamespace(node_map=nodes)

    def picture(self, number: int) -> np.ndarray:
        return (np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) + number).astype(np.uint8)

    def data(self, number: int) -> np.ndarray:
        return np.pad(self.picture(number), ((0, 0), (0, self.padding))).ravel()

    def is_acquiring(self) -> bool:
        return self._on

    def start(self) -> None:
        self._next, self._on = 0, True

    def stop(self) -> None:
        self._on = False

    def destroy(self) -> None:
        """Let go."""

    @contextmanager
    def fetch(self, timeout: float = 0.0) -> Iterator[Buffer]:
        if self._next >= self.frames_there:
            raise TimeoutError("time is up")
        self._next += 1
        yield Buffer(self, self._next - 1)


def install(monkeypatch: pytest.MonkeyPatch) -> GenicamDevice:
    """Whoever imports harvesters finds this one, with this camera."""
    device = GenicamDevice()
    core = ModuleType("harvesters.core")
    core.Harvester = lambda: SimpleNamespace(  # type: ignore[attr-defined]
        add_file=lambda *path, **how: None,
        update=lambda: None,
        create=lambda chosen: device,
        reset=lambda: None,
    )
    monkeypatch.setitem(sys.modules, "harvesters", ModuleType("harvesters"))
    monkeypatch.setitem(sys.modules, "harvesters.core", core)
    return device
