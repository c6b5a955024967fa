"""What examining a part of a rig comes to: checks, and how the part says them."""

from __future__ import annotations

import datetime
import enum
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from haptic_driver.errors import HapticError
from hw.health import REPEATS_S, Asking, Health, with_health
from hw.setting import Setting

if TYPE_CHECKING:
    from haptic_driver.rig.config import RigConfig

ASK_S = 0.01  # between questions
OLD_AFTER = datetime.timedelta(days=365)


class CheckStatus(enum.Enum):
    """What came of one check."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "failed"
    NOT_VERIFIED = "not verified"


class Check(NamedTuple):
    """One thing looked at: what was found, and what to do about it.

    `held`: what is asked of a device, and what it has got now; a generator gets the rest at
    connecting.
    """

    name: str
    status: CheckStatus
    message: str
    hint: str = ""
    held: tuple[Setting, ...] = ()


Checks = Iterator[Check]


class Examination(NamedTuple):
    """The parameters of a part's examination, and how the part reports what it found.

    `name`: what the part's checks are called.
    """

    name: str
    rig: RigConfig
    today: datetime.date

    def called(self, name: str) -> Examination:
        """The same for checks of another name."""
        return self._replace(name=name)

    def ok(self, message: str, held: Iterable[Setting] = ()) -> Check:
        return Check(self.name, CheckStatus.OK, message, "", tuple(held))

    def warning(self, message: str, hint: str = "") -> Check:
        return Check(self.name, CheckStatus.WARNING, message, hint)

    def failed(self, message: str, hint: str = "", held: Iterable[Setting] = ()) -> Check:
        return Check(self.name, CheckStatus.FAILED, message, hint, tuple(held))

    def unverified(self, message: str, hint: str = "", held: Iterable[Setting] = ()) -> Check:
        return Check(self.name, CheckStatus.NOT_VERIFIED, message, hint, tuple(held))

    def dated(self, what: str, on: datetime.date, by: str = "") -> Check:
        """A figure's day; it is to be measured again after a year, by a command."""
        said = f"{what} on {on.isoformat()}"
        if on > self.today:
            return self.warning(f"{said}, which is still to come", f"correct the date{by}")
        if self.today - on > OLD_AFTER:
            return self.warning(f"{said}, {(self.today - on).days} days ago", f"measure again{by}")
        return self.ok(said)

    def heard(self, device: Any, asking: Asking, for_s: float = 2.0 * REPEATS_S) -> Check:
        """How well a device answers that is open: asked for so long by the first of its methods."""
        sensor, until_s = with_health(device, self.name, asking), time.monotonic() + for_s
        while time.monotonic() < until_s:
            getattr(sensor, asking.by[0])()
            time.sleep(ASK_S)
        health: Health = sensor.health
        said = f"asked {health.asked} times, the last reading took {1e3 * health.took_s:.2g} ms"
        if health.wrong:
            return self.failed(f"{said}; {health.wrong}", "look at the sensor and its cable")
        return self.ok(said)

    def told(self, examine: Callable[[Examination], Checks]) -> Checks:
        """Pass the checks on, and what ended them early as one that failed."""
        try:
            yield from examine(self)
        except HapticError as error:
            yield self.failed(error.message, error.hint)
        except Exception as error:  # the driver of a lab's own device may raise anything
            said = f"{type(error).__name__}: {error}"
            yield self.failed(said, "look at what it answers, and at its driver")
