"""The rig and the finger that is measured on it; here the simulated one, with what makes real data
scatter.

The real one is `haptic_driver.lab.measuring.stage_bench`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, sqrt
from typing import NamedTuple, Protocol, Self

import numpy as np

from haptic_driver.lab.measuring.plan import Row, Setting
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.rig import Rig
from haptic_driver.simulation.finger_model import ElectrodeLaw, FrictionLaw
from haptic_driver.simulation.rig import SimulatedRig
from hw.camera.contract import Camera
from hw.force.sensor import ForceReading
from hw.monitor.contract import ElectrodeReading
from model.touch_model import TouchModel


class Place(NamedTuple):
    """Where the finger was along the slide, at a time of the bench's clock."""

    time_s: float
    position_m: float


class AwaitStart(Protocol):
    """What a stroke waits for, the finger pressing; `hold` lets time pass meanwhile."""

    def __call__(self, what: str, hold: Callable[[float], object], /) -> object:
        """Return when the stroke may begin; `what` names it."""


def at_once(what: str, hold: Callable[[float], object], /) -> None:
    """Nothing."""


class Bench(Protocol):
    """A rig, connected, and a finger that slides over it until it is stopped."""

    await_start: AwaitStart

    @property
    def rig(self) -> Rig:
        """The rig as every driver sees it."""

    @property
    def camera(self) -> Camera | None:
        """What sees the touch; None where nothing does."""

    @property
    def time_s(self) -> float:
        """The clock on which the rig is commanded and watched; it goes on with every step."""

    def begin_session(self, session: int, time_s: float) -> None:
        """A finger comes to the rig; the clock of its force readings stands at `time_s`."""

    @property
    def run_up_s(self) -> float:
        """How long the finger takes to gather the row's speed; the first steps are these."""

    @property
    def places(self) -> Sequence[Place]:
        """Where the finger was since the row began, as often as it was looked at."""

    def begin_row(self, number: int, row: Row) -> None:
        """The finger touches for a row; on return it begins to slide, or will with the first
        step.
        """

    def up_to_speed(self) -> None:
        """The run-up is over; HapticError when the finger does not slide."""

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """The finger presses and slides so for `dt_s`; without a load it is lifted."""

    def read_force(self) -> ForceReading:
        """The force sensor's present reading, its time on the session's clock."""

    def forces(self, newest: ForceReading) -> Sequence[ForceReading]:
        """The sensor's readings since the last call, as far as it keeps them; `newest` was read
        now.
        """

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        """The electrode's voltage and current under the present setting; None where no monitor
        measures them. DeviceError.
        """

    def end_row(self) -> None:
        """The row's last force is read; HapticError when the finger did not slide as it should
        have.
        """


@dataclass(frozen=True)
class Scatter:
    """How a simulated finger varies, relative to its model; judged, of the size seen on real
    fingers.

    `session_gain`: standard deviation of the factor that a session's finger has on all its
    friction. `wobble`: standard deviation of friction while sliding, forgotten exponentially over
    `wobble_s`: ridges, stick-slip, tremor. `session_area` and `area_wobble` are the same for the
    touch's own current, which goes with the area of contact.
    """

    session_gain: float = 0.05
    wobble: float = 0.10
    wobble_s: float = 0.010
    session_area: float = 0.02
    area_wobble: float = 0.02


class SimulatedBench:
    """A simulated rig and finger; `seed` and the number of the session and row decide how friction
    varies.

    `friction` and `electrode` stand in for the model's, see `SimulatedRig`. `first_row` is where
    measuring begins.
    """

    def __init__(
        self,
        config: RigConfig,
        model: TouchModel,
        *,
        seed: int,
        first_row: int = 0,
        scatter: Scatter | None = None,
        friction: FrictionLaw | None = None,
        electrode: ElectrodeLaw | None = None,
    ) -> None:
        self._seed = (config.simulation.seed % 2**32, seed)
        self._scatter = scatter or Scatter()
        noise_seed = int(np.random.default_rng([*self._seed, first_row]).integers(2**31))
        simulation = config.simulation.model_copy(update={"seed": noise_seed})
        config = config.model_copy(update={"simulation": simulation})
        self.simulated = SimulatedRig(config, model, friction=friction, electrode=electrode)
        self.simulated.varies = self._vary
        self.await_start: AwaitStart = at_once
        self.run_up_s = 0.0  # it slides at once
        self.places: list[Place] = []
        self._session_gain = self._session_area = 1.0
        self._wobble = 0.0
        self._random = np.random.default_rng(self._seed)

    @property
    def rig(self) -> Rig:
        return self.simulated.rig

    @property
    def camera(self) -> Camera | None:
        return self.simulated.camera

    @property
    def time_s(self) -> float:
        return self.simulated.time_s

    def begin_session(self, session: int, time_s: float) -> None:
        friction, area = (
            np.random.default_rng([*self._seed, 1, session]).standard_normal(2).tolist()
        )
        self._session_gain = exp(self._scatter.session_gain * friction)
        self._session_area = exp(self._scatter.session_area * area)
        # a data file counts from the start of its session
        self.simulated.instruments.ages_from_touch = False
        self.simulated.instruments.plant.time_s = time_s

    def begin_row(self, number: int, row: Row) -> None:
        self._random = np.random.default_rng([*self._seed, 2, number])
        self._wobble = float(self._random.standard_normal())
        self.places = [Place(self.time_s, 0.0)]
        if row.setting.finger == "sliding":
            self.rig.watch(self.time_s)
            self.await_start(f"row {number + 1}", lambda duration_s: None)

    def up_to_speed(self) -> None:
        """See `Bench`."""

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        self.simulated.step(dt_s, normal_force_n, speed_m_s)
        if self.places and normal_force_n > 0.0:
            slid_m = self.places[-1].position_m + speed_m_s * dt_s
            self.places.append(Place(self.time_s, slid_m))

    def _vary(self, dt_s: float) -> None:
        """The finger of the next step is a little another one."""
        kept = exp(-dt_s / self._scatter.wobble_s)
        self._wobble = kept * self._wobble + sqrt(1.0 - kept * kept) * float(
            self._random.standard_normal()
        )
        self.simulated.instruments.finger_gain = self._session_gain * (
            1.0 + self._scatter.wobble * self._wobble
        )
        self.simulated.electrode.touch_gain = self._session_area * (
            1.0 + self._scatter.area_wobble * self._wobble
        )

    def read_force(self) -> ForceReading:
        """See `Bench`; the finger's own time is the session's."""
        reading = self.rig.read_force()
        return reading._replace(time_s=self.simulated.instruments.plant.time_s)

    def forces(self, newest: ForceReading) -> Sequence[ForceReading]:
        return [newest]  # it sends when it is read

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        return self.simulated.electrode.read(setting.frequency_hz, setting.voltage_v)

    def end_row(self) -> None:
        """See `Bench`; a simulated finger slides as ordered."""

    def __enter__(self) -> Self:
        """Serve the instruments and connect to them."""
        self.simulated.__enter__()
        try:
            self.rig.connect()
        except BaseException:
            self.simulated.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Switch off and stop serving."""
        self.simulated.__exit__(None, None, None)
