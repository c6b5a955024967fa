"""How far the stage slides for one row, known before anything moves."""

from __future__ import annotations

from typing import NamedTuple

from haptic_driver.errors import BadInputError
from haptic_driver.lab.measuring.plan import Plan, Setting
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.stages import StageSection

# for set points that take longer than the voltage may rise, and for the stage's own delays
SPARE_S = 1.0


class StageMove(NamedTuple):
    """One slide in the middle of the travel, towards higher positions; at full speed after
    `accelerate_s`.
    """

    start_m: float
    end_m: float
    speed_m_s: float
    accelerate_s: float

    @property
    def length_m(self) -> float:
        """From rest to rest."""
        return self.end_m - self.start_m


def stage_of(config: RigConfig) -> StageSection:
    """The stage that slides the finger; BadInputError for a rig without one."""
    if config.stage is None:
        said = f"rig {config.name} has no stage: nothing slides the finger at a known speed"
        raise BadInputError(
            "no_stage", said, "Add a section [stage] to its file, or measure on a simulated rig"
        )
    return config.stage


def sliding_stage(config: RigConfig) -> StageSection | None:
    """The same; None where a simulated finger slides as it is ordered."""
    by_hand = config.stage is None and config.load_stage.kind == "none"
    return None if config.simulated and by_hand else stage_of(config)


def stroke(setting: Setting, plan: Plan, config: RigConfig) -> StageMove:
    """The slide that a row at `setting` takes: the voltage rises, friction settles and is averaged
    at full speed.
    """
    stage, speed_m_s = stage_of(config), setting.speed_m_s
    accelerate_s = speed_m_s / stage.acceleration_m_s2
    rise_s = setting.voltage_v / config.output.voltage_rise_v_per_s
    length_m = speed_m_s * (accelerate_s + rise_s + plan.settle_s + plan.average_s + SPARE_S)
    middle_m = 0.5 * (stage.travel_m[0] + stage.travel_m[1])
    return StageMove(middle_m - 0.5 * length_m, middle_m + 0.5 * length_m, speed_m_s, accelerate_s)


def beyond_stage(setting: Setting, plan: Plan, config: RigConfig) -> str | None:
    """Why the stage cannot slide so; None when it can."""
    stage = sliding_stage(config)
    if stage is None or setting.finger != "sliding":
        return None
    if setting.speed_m_s > stage.velocity_limit_m_s:
        fastest = f"{1e3 * stage.velocity_limit_m_s:g} mm/s"
        return f"{1e3 * setting.speed_m_s:g} mm/s is faster than the stage may move, {fastest}"
    needed_m, travel_m = (
        stroke(setting, plan, config).length_m,
        stage.travel_m[1] - stage.travel_m[0],
    )
    if needed_m <= travel_m:
        return None
    return (
        f"a slide of {1e3 * needed_m:.0f} mm is longer than the stage's travel,"
        f" {1e3 * travel_m:.0f} mm; settle_s and average_s may be shorter, acceleration_m_s2 higher"
    )
