"""Kinds of stages along the normal, which press the finger on the screen and hold its load."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from haptic_driver.config import Within
from haptic_driver.errors import BadInputError
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.load_controller import LoadSettings
from haptic_driver.rig.load_gains import LoadGains, Stiffness, read_gains
from haptic_driver.rig.part import LoadNewtons, Metres, Part, PartSection, Resource, Wiring
from haptic_driver.rig.parts.stages import examine_lts150, lts150
from hw.stage.letting_go import Mounting

if TYPE_CHECKING:
    from hw.safety.guarded_stage import GuardedStage
    from hw.stage.lts150 import Lts150, StageSettings

Gain = Annotated[float, Within(0.01, 1.0, "more than the whole way swings")]
Drift = Annotated[float, Within(0.01, 20.0, "no loop of this pace takes a faster one")]
Way = Annotated[float, Within(1e-4, 0.05, "no finger is pressed so far")]
Speed = Annotated[float, Within(1e-4, 0.05, "no finger is pressed faster")]
Acceleration = Annotated[float, Within(1e-3, 5.0, "no stage of this kind gathers speed faster")]


Travel = Annotated[list[Metres], Field(min_length=2, max_length=2)]

PRESSES = "whether higher positions press the finger"
CLEAR = "position at which the finger is free; it begins here"
WRONG = "lift off, or stay where it is: whichever is safe for this rig"
TRAVEL = "[lowest, highest] position"


class LoadStageSection(PartSection):
    """What every load stage has: how it stands to the finger, what it does when something is wrong,
    and the gains of the loop.

    It lets go at 1.5 times the load that it is to hold, and at `load_limit_n`. It also lets go when
    the force sensor is silent or saturated, or when the stage does not answer.
    """

    files = ("gains_file",)
    holds: ClassVar[bool] = True

    higher_presses: bool = Field(description=PRESSES)
    clear_m: Metres = Field(description=CLEAR)
    when_wrong: Literal["retract", "stop"] = Field(description=WRONG)
    load_limit_n: LoadNewtons = Field(default=3.0, description="never more, whatever is asked")
    retract_m: Way = Field(default=5e-3, description="so far back, but not beyond `clear_m`")
    reach_m: Way = Field(default=3e-3, description="from `clear_m` until a finger must be felt")
    depth_m: Way = Field(default=3e-3, description="never deeper, from where it is first felt")
    drift_m: Way = Field(
        default=0.8e-3,
        description="never deeper, from where the load was reached, or from the last first touch",
    )
    rate_m_s: Speed = Field(default=5e-3, description="no move that holds the load is faster")
    acceleration_m_s2: Acceleration = Field(default=0.05, description="of all its moves")
    stiffness_n_per_m: Stiffness = Field(
        default=700.0, description="of the finger at 0.5 N; `haptic load tune` measures it"
    )
    softest_n_per_m: Stiffness | None = Field(
        default=None,
        description="of the softest finger that is pressed here, at 0.5 N; one that answers less"
        " is let go. `stiffness_n_per_m` if left out",
    )
    gain: Gain = Field(default=0.45, description="share of the missing way that a move takes")
    drift_per_s: Drift = Field(default=2.0, description="integral gain")
    gains_file: str = Field(
        default="",
        description="that `haptic load tune` writes, beside this file; counts before the keys here",
    )
    tuned_by: str = Field(default="", description="who found the stiffness")
    tuned_at: datetime.date | None = Field(default=None, description="when")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.load_limit_n <= LoadSettings.touch_n:
            raise ValueError(f"load_limit_n must be above the first touch, {LoadSettings.touch_n}")
        if self.when_wrong == "retract" and self.retract_m <= self.depth_m:
            raise ValueError(
                f"retract_m {self.retract_m:g} does not lift off a finger that is pressed by"
                f" depth_m {self.depth_m:g}"
            )
        return self

    @property
    def gains(self) -> LoadGains | None:
        """What was written down; None where nothing was. BadInputError for a file that is none."""
        return read_gains(Path(self.gains_file)) if self.gains_file else None

    def loop(self, target_n: float) -> LoadSettings:
        """How `target_n` is held; BadInputError for a load that cannot be, and as `gains`."""
        gains = self.gains
        names = ("load_limit_n", "reach_m", "depth_m", "drift_m", "rate_m_s", "gain", "drift_per_s")
        try:
            return LoadSettings(
                target_n,
                retracts=self.when_wrong == "retract",
                stiffness_n_per_m=(gains or self).stiffness_n_per_m,
                softest_n_per_m=self.softest_n_per_m or self.stiffness_n_per_m,
                **self.model_dump(include=set(names)),
            )
        except ValueError as error:
            raise BadInputError("bad_load", str(error), "Ask for another load") from error

    def guarded(self) -> GuardedStage | None:
        """The watchdog's arguments for letting go when the driver dies; None for a kind that it
        does not know.
        """
        return None

    def examine(self, at: Examination) -> Checks:
        yield from super().examine(at)
        yield from self._gains(at)

    def _gains(self, at: Examination) -> Checks:
        gains, own = at.called("load gains"), self.gains
        given = self if own is None else own
        found = f"{given.stiffness_n_per_m:g} N/m"
        if given.tuned_by and given.tuned_at:
            yield gains.ok(f"{found}, {given.tuned_by}, {given.tuned_at}")
        else:
            yield gains.unverified(f"{found}, tuned by nobody: haptic load tune")
        dying = at.called("load stage if the driver dies")
        if self.kind == "simulated":
            return
        if self.guarded() is None:
            yield dying.warning("it rests and presses on: the watchdog does not know this kind")
        else:
            does = "lift off" if self.when_wrong == "retract" else "stop"
            yield dying.unverified(f"the watchdog has it {does}", "kill a haptic load hold once")

    def mounting(self) -> Mounting:
        """How the stage stands to the finger."""
        return Mounting(
            1 if self.higher_presses else -1,
            self.clear_m,
            self.retract_m,
            acceleration_m_s2=self.acceleration_m_s2,
        )


class OnLts150(LoadStageSection):
    """A load stage of that make: its travel."""

    travel_m: Travel = Field(description=TRAVEL)

    @model_validator(mode="after")
    def _within_travel(self) -> Self:
        low_m, high_m = self.travel_m
        if not low_m <= self.clear_m <= high_m:
            raise ValueError(f"clear_m {self.clear_m:g} is outside travel_m")
        return self


class SimulatedLoadStageConfig(OnLts150):
    """A simulated LTS150, and the body of the finger that it presses."""

    served_as = "load_stage"

    kind: Literal["simulated"]
    higher_presses: bool = Field(default=True, description=PRESSES)
    clear_m: Metres = Field(default=10e-3, description=CLEAR)
    when_wrong: Literal["retract", "stop"] = Field(default="retract", description=WRONG)
    travel_m: Travel = Field(default=[0.0, 0.15], description=TRAVEL)
    face_m: Metres = Field(default=12e-3, description="position at which the skin touches")
    stiffness_factor: Annotated[float, Within(0.05, 20.0, "no fingertip is so")] = Field(
        default=1.0, description="of the body, against 1 N at 1.75 mm"
    )

    def served_at(self, where: str) -> Lts150LoadStageConfig:
        """As a real one, of which it has the keys."""
        same = self.model_dump(exclude={"kind", "face_m", "stiffness_factor"})
        return Lts150LoadStageConfig(kind="lts150", resource=where, **same)

    def examine(self, at: Examination) -> Checks:
        yield at.ok("simulated")
        yield from self._gains(at)


class Lts150LoadStageConfig(OnLts150):
    """A Thorlabs LTS150 along the normal; unverified on the instrument."""

    served_as = "load_stage"

    kind: Literal["lts150"]
    resource: Resource = Field(description="serial port")

    def guarded(self) -> GuardedStage | None:
        from hw.safety.guarded_stage import GuardedStage

        return GuardedStage(
            self.resource, lts150_settings(self), self.mounting(), self.when_wrong == "retract"
        )

    def examine(self, at: Examination) -> Checks:
        yield from examine_lts150(at, self.resource, lts150_settings(self))
        yield from self._gains(at)

    def make(self, wiring: Wiring) -> Part[Lts150]:
        stage = lts150(self.resource, lts150_settings(self))
        return Part(stage, [stage.connect], [stage.close])


def lts150_settings(section: OnLts150) -> StageSettings:
    """The settings of its driver; no move is faster than letting go."""
    from hw.stage.lts150 import StageSettings

    mounting = section.mounting()
    speed_m_s = max(section.rate_m_s, mounting.retract_m_s)
    low_m, high_m = section.travel_m
    return StageSettings(
        low_m,
        high_m,
        velocity_m_s=section.rate_m_s,
        acceleration_m_s2=section.acceleration_m_s2,
        velocity_limit_m_s=speed_m_s,
        acceleration_limit_m_s2=section.acceleration_m_s2,
    )
