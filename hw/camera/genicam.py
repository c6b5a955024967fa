"""GenICam cameras through `harvesters`: GigE Vision, USB3 Vision, CoaXPress.

Unverified: no such camera was at hand. Names of nodes are those of the Standard Features Naming
Convention, which a camera need not follow. `open` raises an error for a missing one.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.camera.contract import Frame
from hw.errors import DeviceDisconnected, DeviceError, DeviceTimeout, InstrumentRejected

NANOSECONDS = 1e-9  # of a camera's clock [unverified: some count other ticks]


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


class GenicamCamera:
    """A burst of frames by software trigger. See `Camera`; raises DeviceError."""

    def __init__(self, settings: GenicamSettings) -> None:
        self._settings = settings
        self._harvester: Any = None
        self._acquirer: Any = None

    def open(self) -> None:
        """Find the camera, and set trigger, rate and exposure."""
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
            self._set_up(self._acquirer.remote_device.node_map)
        except Exception as error:  # producers have errors of their own
            self.close()
            raise DeviceDisconnected(
                f"camera {told.serial or 'by'} {told.producer}: {error}",
                "Is it connected, and the path of its .cti file right?",
            ) from error

    def _set_up(self, nodes: Any) -> None:
        told = self._settings
        for name, value in (
            ("AcquisitionMode", "MultiFrame"),
            ("AcquisitionFrameCount", told.count),
            ("AcquisitionFrameRateEnable", True),
            ("AcquisitionFrameRate", told.rate_hz),
            ("ExposureTime", 1e6 * told.exposure_s),
            ("TriggerSelector", "AcquisitionStart"),
            ("TriggerSource", "Software"),
            ("TriggerMode", "On"),
        ):
            node = getattr(nodes, name, None)
            if node is None and name == "AcquisitionFrameRateEnable":
                continue  # not every camera has it
            if node is None:
                raise InstrumentRejected(f"the camera has no {name}", "Use another camera")
            node.value = value

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
        """See `Camera`. The first frame is at 0 s: the camera's clock is not the driver's."""
        acquirer, found = self._opened(), []
        try:
            for _ in range(self._settings.count):
                with acquirer.fetch(timeout=self._settings.timeout_s) as buffer:
                    (part,) = buffer.payload.components[:1]
                    shape = (part.height, part.width, -1)
                    image = np.array(part.data).reshape(shape).squeeze()
                    found.append((NANOSECONDS * float(buffer.timestamp_ns), image))
            acquirer.stop()
        except Exception as error:
            raise DeviceTimeout(f"the camera gave {len(found)} frames: {error}") from error
        return [Frame(time_s - found[0][0], image) for time_s, image in found]

    def _opened(self) -> Any:
        if self._acquirer is None:
            raise DeviceDisconnected("the camera is not open")
        return self._acquirer
