"""How well an instrument answers: one record with every reading, kept by whoever asks.

`with_health` stands in a device's place and keeps it, whatever the device's make; a driver knows
nothing of it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from math import inf, nan
from typing import Any, NamedTuple, TypeVar

Answer = TypeVar("Answer")

REPEATS_S = 0.2  # what noise moves never rests for so long
REST_S = 0.05  # a finger that causes no report for longer rests, whatever its tracker's rate
REPORTS = 100  # the newest, which tell how often a tracker reports


class Asking(NamedTuple):
    """How one asks a kind of device: by which of its methods, and what there is to a reading.

    `noise`: the field of a reading that its noise moves all the time. `order`: the method whose
    first argument says what the reading's field `got` is to become. `places`: the fields of which
    one changes with every report.
    """

    by: tuple[str, ...] = ()
    noise: str = ""
    order: str = ""
    got: str = ""
    places: tuple[str, ...] = ()


UNASKED = Asking()
READ = Asking(("read",))
TRACKER = Asking(("read",), places=("position_x_m", "position_y_m"))
FORCE = Asking(("read",), noise="normal_force_n")
STAGE = Asking(("read_status",), order="move_to", got="position_m")
GENERATOR = Asking(("is_on", "set_output", "set_point", "off"))
LINE = Asking(("read", "write"))
MONITOR = Asking(("read_v",))
EVENT_LINE = Asking(("put",))
LINE_IN = Asking(("levels",))


class Health(NamedTuple):
    """What is known of an instrument by its readings so far; times are those of one clock.

    `asked` counts questions, `missed` those without an answer that can be true; `failed` says why
    the last one had none. `taken_s`: when the newest reading was true, by its own stamp. `heard_s`:
    when it came; one that comes again with its stamp is no news. `took_s`: for so long the last
    question lasted. `same_since_s`: since when what noise should move has been one number.
    `ordered` and `got`: what it is to become, and what it is. `zero`: what was taken for zero at
    `zero_s`, where it says so. `every_s` and `jitter_s`: mean and standard deviation of the time
    between reports of what moves, by their stamps.
    """

    name: str
    asked: int = 0
    missed: int = 0
    failed: str = ""
    taken_s: float = -inf
    heard_s: float = -inf
    took_s: float = nan
    same_since_s: float = inf
    saturated: bool = False
    ordered: float | None = None
    got: float | None = None
    zero: tuple[float, ...] = ()
    zero_s: float = -inf
    every_s: float = nan
    jitter_s: float = nan

    def age_s(self, now_s: float) -> float:
        """For so long nothing new has been heard; inf where nothing ever was."""
        return now_s - self.heard_s

    @property
    def same_s(self) -> float:
        """For so long new readings have repeated what noise should move."""
        return max(self.heard_s - self.same_since_s, 0.0)

    @property
    def wrong(self) -> str:
        """Why its newest reading is not to be believed; empty where nothing speaks against it."""
        if self.failed:
            return self.failed
        if self.saturated:
            return "saturated"
        if self.same_s >= REPEATS_S:
            return f"frozen: it has repeated itself for {self.same_s:.1f} s"
        return ""


class HealthKeeper:
    """Asks one device, and keeps its health. Thread-safe; nobody waits for another's question."""

    def __init__(self, name: str, asking: Asking, clock: Callable[[], float]) -> None:
        self.health = Health(name)
        self._asking, self._clock = asking, clock
        self._noting = threading.RLock()  # whoever is interrupted while noting may switch off
        self._last: tuple[object, object] = (None, None)  # stamp, and what noise moves
        self._place: tuple[object, ...] = ()
        self._place_s = -inf
        self._reports = 0

    def ask(self, question: Callable[..., Answer], *args: Any, **named: Any) -> Answer:
        """Pass the question on, with whatever it answers or raises."""
        began_s = self._clock()
        try:
            answer = question(*args, **named)
        except BaseException as error:
            said = str(getattr(error, "message", error)) or type(error).__name__
            self._note(began_s, missed=1, failed=said)
            raise
        self._hear(began_s, answer)
        return answer

    def order(self, act: Callable[..., Answer], *args: Any, **named: Any) -> Answer:
        """Pass an order on, and remember what was asked for."""
        with self._noting:
            self.health = self.health._replace(ordered=_number(*args[:1]))
        return act(*args, **named)

    def take_zero(self, step: Callable[[], object]) -> None:
        """Have the device take what it reads for zero."""
        zero = step()
        values = [_number(one) for one in zero] if isinstance(zero, Iterable) else []
        known = tuple(value for value in values if value is not None)
        with self._noting:
            self.health = self.health._replace(zero=known, zero_s=self._clock())

    def keep_zero(self, step: Callable[[], object], before: Health) -> None:
        """Have it go on with the zero of the one before it."""
        step()
        with self._noting:
            self.health = self.health._replace(zero=before.zero, zero_s=before.zero_s)

    def disown(self, said: str) -> None:
        """Its newest reading cannot be true."""
        with self._noting:
            self.health = self.health._replace(missed=self.health.missed + 1, failed=said)

    def _hear(self, began_s: float, reading: Any) -> None:
        asking, now_s = self._asking, self._clock()
        taken_s = getattr(reading, "time_s", now_s)
        moved = getattr(reading, asking.noise, None) if asking.noise else None
        news: dict[str, Any] = {"saturated": bool(getattr(reading, "saturated", False))}
        with self._noting:
            (stamp, value), self._last = self._last, (taken_s, moved)
        if taken_s != stamp:
            news |= {"taken_s": taken_s, "heard_s": now_s}
            # of one who was not asked meanwhile, nobody knows whether it moved
            if moved is not None and (moved != value or self.health.age_s(now_s) > REPEATS_S):
                news["same_since_s"] = now_s
        place = tuple(getattr(reading, name, nan) for name in asking.places)
        if place != self._place and all(map(math.isfinite, place)):
            news |= self._reported(place, taken_s)
        if asking.got:
            news["got"] = _number(getattr(reading, asking.got, None))
        self._note(began_s, **news)

    def _reported(self, place: tuple[object, ...], taken_s: float) -> dict[str, float]:
        """What a report of another place says of the time between them; older ones fade."""
        interval_s, self._place, self._place_s = taken_s - self._place_s, place, taken_s
        if not 0.0 < interval_s < REST_S:
            return {}
        self._reports += 1
        if self._reports == 1:
            return {"every_s": interval_s, "jitter_s": 0.0}
        share = 1.0 / min(self._reports, REPORTS)
        mean_s, std_s = self.health.every_s, self.health.jitter_s
        off_s = interval_s - mean_s
        square_s2 = (1.0 - share) * (std_s * std_s + share * off_s * off_s)
        return {"every_s": mean_s + share * off_s, "jitter_s": math.sqrt(square_s2)}

    def _note(self, began_s: float, missed: int = 0, failed: str = "", **news: Any) -> None:
        took_s = self._clock() - began_s
        with self._noting:
            before = self.health
            self.health = before._replace(
                asked=before.asked + 1,
                missed=before.missed + missed,
                failed=failed,
                took_s=took_s,
                **news,
            )


class WithHealth:
    """A device as it is, but that some of its methods pass by a `keeper`."""

    def __init__(self, device: Any, keeper: HealthKeeper, asking: Asking) -> None:
        self.device_itself, self.keeper = device, keeper
        for pass_on, methods in ((keeper.ask, asking.by), (keeper.order, (asking.order,))):
            for name in methods:
                if hasattr(device, name):
                    setattr(self, name, _passing(pass_on, device, name))

    @property
    def health(self) -> Health:
        """Of its newest reading."""
        return self.keeper.health

    @property  # type: ignore[misc]
    def __class__(self) -> type:
        """As whom it passes: who looks for a kind of device finds it."""
        return type(self.device_itself)

    def __getattr__(self, name: str) -> Any:
        """Whatever else the device has."""
        return getattr(self.__dict__["device_itself"], name)


def with_health(
    device: Any, name: str, asking: Asking, clock: Callable[[], float] = time.monotonic
) -> Any:
    """The device in whose place `health` says how it answers, by `name` and as it is `asking`."""
    return WithHealth(device, HealthKeeper(name, asking, clock), asking)


def _number(value: object = None) -> float | None:
    return float(value) if isinstance(value, float | int) else None


def _passing(pass_on: Callable[..., Any], device: Any, name: str) -> Callable[..., Any]:
    """A method that is looked for when it is called, as any other is."""

    def method(*args: Any, **named: Any) -> Any:
        return pass_on(getattr(device, name), *args, **named)

    return method
