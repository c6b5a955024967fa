"""What is rendered: chosen by name or by friction, and handed over to render."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import RefusedError, SceneChanged, SceneShown
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.output_pump import PUMP_PERIOD_S
from haptic_driver.errors import BadInputError, shown
from haptic_driver.processes.shared_memory import Output, SharedState
from haptic_driver.recording.scenes import as_changes, change_said, event_data
from haptic_driver.render.scene import Scene
from haptic_driver.render.texture import Script, Target, Uniform
from haptic_driver.textures.objects import Add, Change, Move, SceneDescription, Set, SetBackground
from haptic_driver.textures.reach import Demand
from haptic_driver.textures.scene import Drawn, Live, require_on_screen

USUAL_FORCE_N = 0.5  # where no finger says how it presses
FAR = 0.1  # so far beyond the reachable range, relative, a friction is a slip of the hand
MOST_FAR = 0.5  # of a texture's area
EMPTY = Drawn(SceneDescription(), {})
TAKE_OVER_S = 0.5  # render takes up a target within a tick; a stalled one never


class Targets:
    """The present target and its name. `choosing` is of whoever hands one over; `orders.lock`
    guards both.

    `reachable`: the lowest and the highest friction under a load. `live` is the target where it
    is a scene, `changing` of whoever changes it; objects lie on a screen of `screen_m`.
    """

    def __init__(
        self,
        shared: SharedState,
        orders: Orders,
        events: EventLog,
        clock: Callable[[], float],
        reachable: Callable[[float], tuple[float, float]],
        loader: Loader,
        screen_m: tuple[float, float],
    ) -> None:
        self.changing = threading.Lock()
        self.choosing = threading.Lock()
        self.target: Target | None = None
        self.name: str | None = None
        self.live: Live | None = None
        self._changes = 0
        self._given_s = 0.0  # when render was given what it has now
        self._screen_m = screen_m
        self._shared = shared
        self._orders = orders
        self._events = events
        self._clock = clock
        self._reachable = reachable
        self._loader = loader
        reachable(USUAL_FORCE_N)  # compiled from here on

    def forget(self) -> None:
        """None is asked for."""
        self.target = self.name = self.live = None

    def set(self, token: str, cof: float, *, nearest: bool = False) -> None:
        """One friction everywhere. Raises BadInputError for one far out of reach, unless the
        nearest will do.
        """
        asked_at = self._orders.overtaken
        # without the right to ask there is no answer on what is reachable
        self._orders.renew(token)
        load_n, (low, high) = self.reach()
        if not (nearest or (1.0 - FAR) * low <= cof <= (1.0 + FAR) * high):
            raise _out_of_reach(f"friction {cof:g} is", load_n, low, high)
        with self.changing:
            self._hand_over(token, asked_at, Uniform(cof), None)
            self._events.tell("target", f"friction {cof:g}", cof=cof)

    def play(self, token: str, texture: str, *, nearest: bool = False) -> None:
        """A texture, or a script from its beginning. Raises BadInputError as `set` does, where most
        of it is far.
        """
        asked_at = self._orders.overtaken
        self._orders.renew(token)
        load_n, (low, high) = self.reach()
        target, asked, drawn, gain = self._loader.texture(
            texture, ((1.0 - FAR) * low, (1.0 + FAR) * high)
        )
        if not nearest:
            _require_near(texture, asked, load_n, low, high)
        if isinstance(target, Script):
            target = target.started(self._clock())
        with self.changing:
            self._hand_over(token, asked_at, target, shown(texture), drawn)
            self._events.tell("texture", texture, perceptual_gain=gain)
            self.tell_scene()

    def change_scene(
        self, token: str, changes: Sequence[Change], *, show: bool = False, nearest: bool = False
    ) -> SceneChanged:
        """Change the present scene, or begin one. Raises BadInputError as `set` and `play` do, and
        for a change that cannot be; then nothing is changed.
        """
        asked_at = self._orders.overtaken
        self._orders.renew(token)
        with self.changing:
            said, quick = [change_said(change) for change in changes], None
            if self.live is not None and not show:
                quick = self.live.moved(changes, self._screen_m)
            if quick is not None:
                self._rearrange(token, quick)
                return self._tell_changes(said, EMPTY)
            before = None if self.live is None else self.live.drawn
            drawn = (before or EMPTY).changed((before or EMPTY).described.changed(changes))
            load_n, (low, high) = self.reach()
            if not nearest:
                _require_reach(changes, load_n, low, high)
            for material in drawn.missing:
                reach = (1.0 - FAR) * low, (1.0 + FAR) * high
                made, asked = self._loader.material(material, reach)
                if not nearest and material.width_mm is None:
                    _require_near(material.name, asked, load_n, low, high)
                drawn = drawn.with_material(material, made)
            self._require_on_screen(drawn, changes)
            drawn = drawn.arranged()
            if not show and before is not None and drawn.laid == before.laid:
                self._rearrange(token, Live(drawn))
                return self._tell_changes(said, EMPTY)
            drawn = drawn.without_leftovers()
            name = self.name if before is not None else "scene"
            whole = before is None or show
            self._hand_over(token, asked_at, drawn.scene(), name, drawn, begins=whole)
            return self._tell_changes(as_changes(drawn.described) if whole else said, drawn)

    def scene_shown(self) -> SceneShown:
        live, rendering = self.live, self._orders.rendering
        scene = None if live is None else live.drawn.described
        return SceneShown(number=self._changes, rendering=rendering, scene=scene)

    def tell_scene(self, since_s: float | None = None) -> None:
        """All of the present scene as an event, where there is one: for who begins to listen, from
        `since_s` on.
        """
        if self.live is not None:
            self._given_s = self._given_s if since_s is None else since_s
            drawn = self.live.drawn
            self._tell_changes(as_changes(drawn.described), drawn)

    def _tell_changes(self, changes: list[dict[str, Any]], read: Drawn) -> SceneChanged:
        """As events, with what the textures that were read for it hold."""
        assert self.live is not None
        self._changes += 1
        rendering, time_s = self._orders.rendering, self._given_s
        said = f"{len(changes)} change{'s' * (len(changes) != 1)}"
        for data in event_data(self._changes, changes, read.materials):
            self._events.add("scene", said, data, time_s)
        objects = self.live.count
        return SceneChanged(
            number=self._changes, time_s=time_s, objects=objects, rendering=rendering
        )

    def _require_on_screen(self, drawn: Drawn, changes: Sequence[Change]) -> None:
        placed = {c.id for c in changes if isinstance(c, Add | Move | Set)}
        for each in drawn.described.object:
            if each.id in placed:
                require_on_screen(each, drawn, self._screen_m)

    def _rearrange(self, token: str, live: Live) -> None:
        """Other objects of the same materials, from the next tick on; nothing begins to be
        rendered.
        """
        with self.choosing, self._orders.lock:
            self._orders.machine.renew(token, self._clock())
            assert isinstance(self.target, Scene)  # of the lease that holds
            self._given_s = time.monotonic()
            self._shared.scene.write(self._orders.order.target, live.objects)
            self.target, self.live = self.target.with_objects(live.objects), live

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

    def _hand_over(
        self,
        token: str,
        asked_at: int,
        target: Target,
        name: str | None,
        drawn: Drawn | None = None,
        *,
        begins: bool = True,
    ) -> None:
        """Render takes it up between two ticks, and begins to render where it did not, if it
        `begins`.

        `asked_at`: the number of `overtaken` when it was asked for. RefusedError where somebody
        has switched off since: a texture may take seconds to read.
        """
        with self.choosing:
            with self._orders.lock:
                self._orders.machine.renew(token, self._clock())  # whoever asks is alive
                number = self._orders.order.target
            self.await_taken(lambda output: output.target == number)
            self._shared.targets.write(number + 1, target)
            with self._orders.lock:
                if begins and asked_at != self._orders.overtaken:
                    raise RefusedError(
                        "overtaken", "the output was switched off meanwhile", "ask again"
                    )
                self._given_s = time.monotonic()
                if begins:
                    self._orders.render(token, number + 1)
                else:
                    self._orders.use_target(token, number + 1)
                self.target, self.name = target, name
                self.live = None if drawn is None else Live(drawn)

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


def _require_near(what: str, asked: Demand, load_n: float, low: float, high: float) -> None:
    """Refuse a texture most of which is far out of reach."""
    if asked.share_below + asked.share_above > MOST_FAR:
        said = f"most of {what}, {asked.cof_low:.3g} to {asked.cof_high:.3g}, is"
        raise _out_of_reach(said, load_n, low, high)


def _require_reach(changes: Sequence[Change], load_n: float, low: float, high: float) -> None:
    """Refuse a friction of an object or background that is far out of reach."""
    for change in changes:
        cof = change.cof if isinstance(change, Add | Set | SetBackground) else None
        if cof is not None and not (1.0 - FAR) * low <= cof <= (1.0 + FAR) * high:
            raise _out_of_reach(f"friction {cof:g} is", load_n, low, high)


def _out_of_reach(what: str, load_n: float, low: float, high: float) -> BadInputError:
    return BadInputError(
        "unreachable",
        f"{what} far out of reach: {low:.3g} to {high:.3g} at {load_n:.2g} N",
        f"Ask for {low:.3g} to {high:.3g}, or give nearest: the nearest that can be had",
    )
