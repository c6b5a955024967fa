"""GenICam cameras through `harvesters`: GigE Vision, USB3 Vision, CoaXPress.

Unverified: no such camera was at hand. Names of features are those of the Standard Features Naming
Convention, which a camera need not follow. `open` raises an error for a missing one, and for one
that holds another value than was set.
"""

from __future__ import annotations

import contextlib
import importlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.camera.contract import Frame, Image
from hw.errors import DeviceDisconnected, DeviceError, DeviceTimeout, InstrumentRejected
from hw.setting import Setting, Value

NANOSECONDS = 1e-9
PIXELS = "Mono8"
# Share by which a number may be off: a sensor exposes for whole lines.
WHOLE_LINES = 0.02
# Not every camera has these.
OPTIONAL = ("ExposureAuto", "GainAuto", "AcquisitionFrameRateEnable")


@dataclass(frozen=True)
class GenicamSettings:
    """`producer` is the path of the transport layer's .cti file; an empty `serial` is the only
    camera there. `count` frames follow a trigger, `rate_hz` of them a second.
    """

    producer: str
    serial: str = ""
    count: int = 5
    rate_hz: float = 10.0
    exposure_s: float = 1e-3
    timeout_s: float = 2.0

    def features(self) -> Iterator[tuple[str, Value]]:
        """What is set, in order: automatic changes first, which lock what they change."""
        yield "PixelFormat", PIXELS
        yield "ExposureAuto", "Off"
        yield "GainAuto", "Off"
        yield "AcquisitionMode", "MultiFrame"
        yield "AcquisitionFrameCount", self.count
        yield "AcquisitionFrameRateEnable", True
        yield "ExposureTime", 1e6 * self.exposure_s
        yield "AcquisitionFrameRate", self.rate_hz
        yield "TriggerSelector", "AcquisitionStart"
        yield "TriggerSource", "Software"
        yield "TriggerMode", "On"


class GenicamCamera:
    """A burst of frames by software trigger. See `Camera`; raises DeviceError."""

    def __init__(self, settings: GenicamSettings) -> None:
        self.resource = f"camera {settings.serial or 'by'} {settings.producer}"
        self._settings = settings
        self._harvester: Any = None
        self._acquirer: Any = None
        self._held: list[Setting] = []

    def held(self) -> list[Setting]:
        """Features as set and as read back, by their names; exposure in microseconds."""
        return list(self._held)

    def open(self) -> None:
        """Find the camera, set its features, and read each back."""
        try:
            core = importlib.import_module("harvesters.core")
        except ImportError as error:
            raise DeviceError(
                f"a GenICam camera needs a package that is not there ({error})",
                "Install it: pip install 'haptic-driver[genicam]'",
            ) from error
        told = self._settings
        try:
            self._harvester = core.Harvester()
            self._harvester.add_file(told.producer, check_existence=True, check_validity=True)
            self._harvester.update()
            chosen = {"serial_number": told.serial} if told.serial else 0
            self._acquirer = self._harvester.create(chosen)
        except Exception as error:  # producers have errors of their own
            self.close()
            raise DeviceDisconnected(
                f"{self.resource}: {error}", "Is it connected, and the path of its .cti file right?"
            ) from error
        try:
            self._set_up(self._acquirer.remote_device.node_map)
        except DeviceError:
            self.close()
            raise

    def _set_up(self, nodes: Any) -> None:
        self._held = []
        for name, value in self._settings.features():
            node = getattr(nodes, name, None)
            if node is None and name in OPTIONAL:
                continue
            if node is None:
                raise InstrumentRejected(f"the camera has no {name}", "Use another camera")
            try:
                node.value = value
            except Exception as error:  # each producer has errors of its own
                said = f"the camera does not take {name} {value}: {error}"
                raise InstrumentRejected(said, "Set what it can do") from error
        # what was set later may have changed what was set before
        for name, value in self._settings.features():
            if (node := getattr(nodes, name, None)) is not None:
                self._held.append(Setting(name, value, node.value))
        for name, asked, got in self._held:
            if not _is_as_asked(asked, got):
                said = f"{self.resource}: {name} {asked} was asked for, it is {got}"
                raise InstrumentRejected(said, f"Ask for what it can do: {name} {got}")

    def close(self) -> None:
        """Stop and let go; never raises."""
        for each, how in ((self._acquirer, "destroy"), (self._harvester, "reset")):
            if each is not None:
                with contextlib.suppress(Exception):  # it is given up anyway
                    getattr(each, how)()
        self._acquirer = self._harvester = None

    def start(self) -> None:
        acquirer = self._opened()
        try:
            if acquirer.is_acquiring():
                acquirer.stop()
            acquirer.num_buffers = self._settings.count
            acquirer.start()
            acquirer.remote_device.node_map.TriggerSoftware.execute()
        except Exception as error:
            raise DeviceError(f"the camera is not triggered: {error}") from error

    def frames(self) -> Sequence[Frame]:
        """See `Camera`. The first frame is at 0 s: the camera's clock is not the driver's.

        Frames that came incomplete are left out. DeviceTimeout where none came whole.
        """
        acquirer, found, lost = self._opened(), [], "nothing came"
        try:
            for number in range(self._settings.count):
                try:
                    with acquirer.fetch(timeout=self._settings.timeout_s) as buffer:
                        if buffer.is_complete() and not _is_empty(buffer):
                            found.append((self._time_s(buffer, number), _image(buffer)))
                        else:
                            lost = f"frame {number} came incomplete"
                except DeviceError:
                    raise
                except Exception as error:  # a producer's own, mostly that time is up
                    lost = f"frame {number}: {error}"
                    break
        finally:
            with contextlib.suppress(Exception):  # a next start stops it too
                acquirer.stop()
        if not found:
            hint = "Look at cable, bandwidth and trigger; take fewer or smaller frames"
            raise DeviceTimeout(f"{self.resource}: no frame is whole: {lost}", hint)
        return [Frame(time_s - found[0][0], image) for time_s, image in found]

    def _time_s(self, buffer: Any, number: int) -> float:
        """By the camera's clock; without one, by the frame rate that was read back."""
        with contextlib.suppress(Exception):  # a producer without it raises its own
            return NANOSECONDS * float(buffer.timestamp_ns)
        with contextlib.suppress(Exception):
            return float(buffer.timestamp) / float(buffer.timestamp_frequency)
        rates = [each.got for each in self._held if each.name == "AcquisitionFrameRate"]
        return number / float(rates[0] or self._settings.rate_hz)

    def _opened(self) -> Any:
        if self._acquirer is None:
            raise DeviceDisconnected("the camera is not open")
        return self._acquirer


def _is_as_asked(asked: Value, got: Any) -> bool:
    if isinstance(asked, float):
        return math.isclose(asked, float(got), rel_tol=WHOLE_LINES)
    return bool(asked == got)


def _is_empty(buffer: Any) -> bool:
    """Whether a buffer has no pixels at all, which some producers call complete."""
    components = buffer.payload.components
    return bool(components and components[0] is not None and not components[0].height)


def _image(buffer: Any) -> Image:
    """Grey [y, x]; rows may be longer than what is seen. InstrumentRejected for packed pixels."""
    components = buffer.payload.components
    part = components[0] if components else None
    if part is None or part.data_format != PIXELS:
        sends = "pixels" if part is None else part.data_format
        said = f"the camera sends {sends}, in a format that is not understood"
        raise InstrumentRejected(said, f"Set its PixelFormat to {PIXELS}")
    data = np.array(part.data).ravel()
    longer, rest = divmod(data.size, part.height)
    if rest or longer < part.width:
        said = f"{data.size} bytes came for {part.width} x {part.height} pixels"
        raise InstrumentRejected(said, f"Set its PixelFormat to {PIXELS}, without chunk data")
    return np.asarray(data.reshape(part.height, longer)[:, : part.width], dtype=np.uint8)
