"""What is rendered: chosen by name or by friction, and handed over to render."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.output_pump import PUMP_PERIOD_S
from haptic_driver.errors import BadInputError, shown
from haptic_driver.processes.shared_memory import Output, SharedState
from haptic_driver.render.texture import Script, Target, Uniform

USUAL_FORCE_N = 0.5  # where no finger says how it presses
FAR = 0.1  # so far beyond the reachable range, relative, a friction is a slip of the hand
MOST_FAR = 0.5  # of a texture's area
TAKE_OVER_S = 0.5  # render takes up a target within a tick; a stalled one never


class Targets:
    """The present target and its name. `choosing` is of whoever hands one over; `orders.lock`
    guards both.

    `reachable`: the lowest and the highest friction under a load.
    """

    def __init__(
        self,
        shared: SharedState,
        orders: Orders,
        events: EventLog,
        clock: Callable[[], float],
        reachable: Callable[[float], tuple[float, float]],
        loader: Loader,
    ) -> None:
        self.choosing = threading.Lock()
        self.target: Target | None = None
        self.name: str | None = None
        self._shared = shared
        self._orders = orders
        self._events = events
        self._clock = clock
        self._reachable = reachable
        self._loader = loader
        reachable(USUAL_FORCE_N)  # compiled from here on

    def forget(self) -> None:
        """None is asked for."""
        self.target = self.name = None

    def set(self, token: str, cof: float, *, nearest: bool = False) -> None:
        """One friction everywhere. Raises BadInputError for one far out of reach, unless the
        nearest will do.
        """
        self._orders.renew(token)  # who may not ask is not told what is reachable
        load_n, (low, high) = self.reach()
        if not (nearest or (1.0 - FAR) * low <= cof <= (1.0 + FAR) * high):
            raise _out_of_reach(f"friction {cof:g} is", load_n, low, high)
        self._hand_over(token, Uniform(cof), None)
        self._events.tell("target", f"friction {cof:g}", cof=cof)

    def play(self, token: str, texture: str, *, nearest: bool = False) -> None:
        """A texture, or a script from its beginning. Raises BadInputError as `set` does, where most
        of it is far.
        """
        self._orders.renew(token)
        load_n, (low, high) = self.reach()
        target, asked = self._loader.texture(texture, ((1.0 - FAR) * low, (1.0 + FAR) * high))
        if not nearest and asked.share_below + asked.share_above > MOST_FAR:
            what = f"most of {texture}, {asked.cof_low:.3g} to {asked.cof_high:.3g}, is"
            raise _out_of_reach(what, load_n, low, high)
        self._hand_over(
            token,
            target.started(self._clock()) if isinstance(target, Script) else target,
            shown(texture),
        )
        self._events.tell("texture", texture)

    def asked_cof(self, output: Output, samples: NDArray[np.void]) -> float | None:
        """What was asked for, also before render has taken it up.

        Of a texture it is the mean beside what was measured in samples [n], or else the newest.
        """
        if isinstance(self.target, Uniform):
            return self.target.cof
        if output.target != self._orders.order.target:
            return None
        measured = np.isfinite(samples["measured_cof"]) & np.isfinite(samples["target_cof"])
        if measured.any():
            return float(samples["target_cof"][measured].mean())
        return output.target_cof if math.isfinite(output.target_cof) else None

    def reach(self) -> tuple[float, tuple[float, float]]:
        """The load of the finger that is there now, N, and the lowest and highest friction under
        it.
        """
        sensed = self._shared.sensed.read()
        load_n = (
            sensed.normal_force_n
            if sensed.touching and sensed.normal_force_n > 0.0
            else USUAL_FORCE_N
        )
        return load_n, self._reachable(load_n)

    def _hand_over(self, token: str, target: Target, name: str | None) -> None:
        """Render takes it up between two ticks."""
        with self.choosing:
            with self._orders.lock:
                self._orders.machine.renew(token, self._clock())  # whoever asks is alive
                number = self._orders.order.target
            self.await_taken(lambda output: output.target == number)
            self._shared.targets.write(number + 1, target)
            with self._orders.lock:
                self._orders.render(token, number + 1)
                self.target, self.name = target, name

    def await_taken(self, is_taken: Callable[[Output], bool]) -> None:
        """Until render uses what it was given before, since the next takes the place of the one
        before that.
        """
        until_s = self._clock() + TAKE_OVER_S
        while not is_taken(self._shared.output.read()):
            if self._clock() > until_s:
                raise RefusedError(
                    "render_stalls",
                    "render does not take up what it is given",
                    "look at the status",
                )
            time.sleep(PUMP_PERIOD_S)


def _out_of_reach(what: str, load_n: float, low: float, high: float) -> BadInputError:
    return BadInputError(
        "unreachable",
        f"{what} far out of reach: {low:.3g} to {high:.3g} at {load_n:.2g} N",
        f"Ask for {low:.3g} to {high:.3g}, or accept the nearest too",
    )
