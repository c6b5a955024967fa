"""Load and friction on a screen without a force sensor, from the electrode's current, as a force
sensor's readings.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from math import nan

from haptic_driver.errors import HapticError, message_of
from haptic_driver.live.touch_by_current import Felt, TouchByCurrent
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.started import start_thread
from haptic_driver.surface.models import load_model
from hw.errors import DeviceError
from hw.force.sensor import ForceReading
from hw.monitor.contract import ElectrodeReading

PERIOD_S = 0.02  # between readings, and a monitor's own time
AGE_S = 0.1

ReadElectrode = Callable[[float], ElectrodeReading | None]
"""What is at the electrode at a carrier in Hz; None where no monitor tells it. Raises DeviceError.
"""


class CurrentSensor:
    """Asks the monitor in a thread of its own, from `start` on; a load is the usual one while
    nothing tells.

    `stray_f` is what lies beside the finger; `carrier_hz` the carrier of the moment, None unless
    the finger slides, since a resting one is another touch; `model` the name of the model.
    """

    def __init__(
        self,
        electrode: ReadElectrode,
        usual_n: float,
        stray_f: float,
        carrier_hz: Callable[[], float | None],
        model: Callable[[], str],
    ) -> None:
        self._electrode, self._usual_n, self._stray_f = electrode, usual_n, stray_f
        self._carrier_hz, self._model = carrier_hz, model
        self._felt_s = time.monotonic()
        self._last = self._unknown = ForceReading(self._felt_s, usual_n, nan, False)
        self._failed: DeviceError | None = None
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        self._thread = start_thread("current", self._run)

    def read(self) -> ForceReading:
        """The newest estimate, or that nothing is known for AGE_S. Raises DeviceError when the
        monitor fails.
        """
        if self._failed is not None:
            raise self._failed
        now_s, last = time.monotonic(), self._last
        known = last if now_s - last.time_s <= AGE_S else self._unknown
        return known._replace(time_s=now_s)

    def close(self) -> None:
        self._ending.set()
        if self._thread is not None:
            join_within(AGE_S, [self._thread])

    def _run(self) -> None:
        name, touch = "", None
        while not self._ending.wait(PERIOD_S):
            try:
                if touch is None or name != self._model():
                    name, touch = self._model(), None
                    touch = TouchByCurrent(load_model(name), self._usual_n, self._stray_f)
                self._look(touch)
            except DeviceError as error:  # tried again, as a sensor is
                self._failed = error
            except HapticError as error:  # a model's file that has gone meanwhile
                self._failed = DeviceError(error.message, error.hint)
            except BaseException as error:  # of a plug-in
                self._failed = DeviceError(
                    message_of(error), "a fault of the electrode monitor's driver"
                )
            else:
                self._failed = None

    def _look(self, touch: TouchByCurrent) -> None:
        carrier_hz, now_s = self._carrier_hz(), time.monotonic()
        reading = None if carrier_hz is None else self._electrode(carrier_hz)
        felt = None
        if reading is not None and carrier_hz is not None:
            felt, self._felt_s = touch.felt(carrier_hz, reading, now_s - self._felt_s), now_s
        load_n, cof = felt or Felt(self._usual_n, nan)
        self._last = ForceReading(now_s, load_n, cof * load_n, False)
