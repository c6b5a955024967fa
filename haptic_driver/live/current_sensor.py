"""The electrode's monitor, read in a thread of its own; and what it says of a touch where no force
sensor is.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from math import inf, nan
from typing import NamedTuple

from haptic_driver.errors import HapticError, message_of
from haptic_driver.live.touch_by_current import CurrentTouch, TouchByCurrent
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.started import start_thread
from hw.errors import DeviceError
from hw.monitor.contract import ElectrodeReading

PERIOD_S = 0.02  # between readings of an estimate, and a monitor's own time
RECORDED_S = 0.1  # between readings that are only kept
AGE_S = 0.1
KEPT_S = 0.25  # so long a reading is the present one where nothing is estimated

ReadElectrode = Callable[[float], ElectrodeReading | None]
"""What is at the electrode at a carrier in Hz; None where no monitor tells it. Raises DeviceError.
"""


class Carried(NamedTuple):
    """The carrier of the moment, whether the finger slides, and its contact area, NaN where the
    screen does not tell it.
    """

    frequency_hz: float
    slides: bool
    contact_area_m2: float = nan


class Seen(NamedTuple):
    """A reading and its time; `felt` is what it says of the touch, where that is estimated."""

    time_s: float = -inf
    reading: ElectrodeReading | None = None
    felt: CurrentTouch | None = None


NOTHING_SEEN = Seen()


class TouchEstimate:
    """Load and friction by the current, for the model of the moment.

    `usual_n`: a finger's usual load; `stray_f`: what lies beside the finger; `model`: the model's
    name.
    """

    def __init__(self, usual_n: float, stray_f: float, model: Callable[[], str]) -> None:
        self._usual_n, self._stray_f, self._model = usual_n, stray_f, model
        self._name = ""
        self._touch: TouchByCurrent | None = None
        self._felt_s = -inf

    def of(
        self, now_s: float, carrier: Carried | None, reading: ElectrodeReading | None
    ) -> CurrentTouch | None:
        """What a reading adds. Only of a finger that slides: a resting one is another touch.

        Raises BadInputError where the model cannot be loaded.
        """
        touch, name = self._touch, self._model()
        if touch is None or name != self._name:
            self._touch = touch = TouchByCurrent(load_model(name), self._usual_n, self._stray_f)
            self._name = name
        if carrier is None or reading is None or not carrier.slides:
            return None
        elapsed_s, self._felt_s = now_s - self._felt_s, now_s
        return touch.felt(carrier.frequency_hz, reading, elapsed_s, carrier.contact_area_m2)


class ElectrodeWatch:
    """Looks at the electrode's monitor while something is driven; in a thread from `start` on.

    With an `estimate` it looks as often as that needs, and a monitor that fails is a sensor that
    does.
    """

    def __init__(
        self,
        electrode: ReadElectrode,
        carrier: Callable[[], Carried | None],
        estimate: TouchEstimate | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._electrode, self._carrier, self._estimate = electrode, carrier, estimate
        self._clock = clock
        self.period_s = RECORDED_S if estimate is None else PERIOD_S
        self._age_s = KEPT_S if estimate is None else AGE_S
        self._last = NOTHING_SEEN
        self._failed: DeviceError | None = None
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        self._thread = start_thread("current", self._run)

    def newest(self) -> Seen:
        """The newest reading, nothing where that is old. Raises DeviceError where friction is
        estimated and the monitor fails.
        """
        if self._failed is not None and self._estimate is not None:
            raise self._failed
        last = self._last
        return last if self._clock() - last.time_s <= self._age_s else NOTHING_SEEN

    def look(self) -> None:
        """Read once. Raises DeviceError and HapticError."""
        carrier, now_s = self._carrier(), self._clock()
        reading = None if carrier is None else self._electrode(carrier.frequency_hz)
        felt = None if self._estimate is None else self._estimate.of(now_s, carrier, reading)
        self._last = NOTHING_SEEN if reading is None else Seen(now_s, reading, felt)

    def close(self) -> None:
        self._ending.set()
        if self._thread is not None:
            join_within(AGE_S, [self._thread])

    def _run(self) -> None:
        while not self._ending.wait(self.period_s):
            try:
                self.look()
            except DeviceError as error:  # tried again, as a sensor is
                self._failed = error
            except HapticError as error:  # a model's file that has gone meanwhile
                self._failed = DeviceError(error.message, error.hint)
            except BaseException as error:  # of a plug-in
                said = "a fault of the electrode monitor's driver"
                self._failed = DeviceError(message_of(error), said)
            else:
                self._failed = None
