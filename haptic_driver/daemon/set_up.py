"""Turn the names of a rig and a model into the settings of the daemon's processes; the latency
budget.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from haptic_driver.daemon.envelope_process import BEHIND_S
from haptic_driver.daemon.judge import JudgeSettings
from haptic_driver.daemon.readings import not_covered
from haptic_driver.daemon.render_process import Nothing, RenderSettings
from haptic_driver.errors import BadInputError
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.live.follow import FollowSettings
from haptic_driver.live.touch_by_current import LEVEL_STD
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import SurfaceFile
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import Sensed
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.envelope_writer import LEAST_LEAD_S
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.parts.finger_trackers import reports_of
from haptic_driver.rig.placement import USUAL_SPEED_M_S, Placement, at_turns, placement
from haptic_driver.rig.slide import read_slide
from haptic_driver.rig.tick_settings import finger_settings, tick_settings
from haptic_driver.signals import TICK_S
from model.description import ModelDescription

PUBLISHED = "reference"  # the model that protects where none but a fit is named
SCHEDULING_S = 0.01  # by so much a position may be late on a machine that does other things too


@dataclass(frozen=True)
class DaemonSettings:
    """A rig, a surface to drive it by, and how to render.

    `rig` and `model` are the names that were given. `allow_no_rt`: real hardware without real-time
    scheduling. `amplifier_record`: a file in which simulated instruments write down what was at the
    electrode. `finger`: the simulated one's function, as module:function. `slide`: a file of what
    it does. `carrier_hz`: the only carrier, in place of the rig's policy; `feedback`: from measured
    friction. `signed`: the surface whose worst case protects whatever is rendered by; the first
    one, unless given.
    """

    rig: str
    model: str
    config: RigConfig
    surface: SurfaceFile
    render: RenderSettings
    allow_no_rt: bool = False
    amplifier_record: Path | None = None
    finger: str | None = None
    slide: Path | None = None
    carrier_hz: float | None = None
    feedback: bool = True
    signed: SurfaceFile | None = None

    def __post_init__(self) -> None:
        """Keep the first surface for good."""
        if self.signed is None:
            object.__setattr__(self, "signed", self.surface)

    @property
    def protected(self) -> SurfaceFile:
        """The surface with the worst case by which voltages are judged."""
        return self.surface if self.signed is None else self.surface.protected_by(self.signed)

    def not_covered(self, sensed: Sensed) -> str | None:
        """See `readings.not_covered`; one touch is that of the signed model's finger."""
        if not (sensed.palm or sensed.contacts > 1.0 or sensed.contact_area_m2 > 0.0):
            return None
        signed = self.surface if self.signed is None else self.signed
        one_touch_m2 = signed.provenance["model"]["parameters"]["contact_area_m2"]["value"]
        return not_covered(sensed, self.config.operating_limits(), float(one_touch_m2))

    def with_model(self, model: str, description: ModelDescription) -> DaemonSettings:
        """The same with another model's surface, which is solved. Raises BadInputError."""
        surface = build_surface(description, self.config.operating_limits())
        return replace(self.with_surface(surface, self.render.surface), model=model)

    def with_surface(self, surface: SurfaceFile, number: int) -> DaemonSettings:
        """The same with another surface, which has that number among orders."""
        config = self.config
        if self.carrier_hz is not None:
            chosen = {"policy": "fixed_frequency", "fixed_frequency_hz": self.carrier_hz}
            config = config.model_copy(
                update={"controller": config.controller.model_copy(update=chosen)}
            )
        stages = render_settings(config, surface, feedback=self.feedback, signed=self.signed)
        render = replace(stages, surface=number)
        return replace(self, surface=surface, render=render)

    @property
    def observed(self) -> tuple[FollowSettings, JudgeSettings]:
        """The observer's settings. Raises BadInputError."""
        config = self.config
        noise_n = config.simulation.force_noise_n if config.simulated else 0.0
        judge = JudgeSettings(load_perception(), reach_hz(config), noise_n)
        limits = config.operating_limits()
        return FollowSettings(self.model, self.surface, limits, self.latency_budget_s()), judge

    def latency_budget_s(self, lead_s: float = 0.0) -> dict[str, float]:
        """See the function; with the lead of an envelope that its writer has reported."""
        return latency_budget_s(self.config, self.render.period_s, lead_s or self.render.lead_s)


def daemon_settings(
    rig: str,
    model: str,
    *,
    allow_no_rt: bool = False,
    amplifier_record: Path | None = None,
    slide: Path | None = None,
) -> DaemonSettings:
    """Everything by name; solves the surface. Raises BadInputError."""
    config = load_rig(rig)
    if slide is not None:
        if not config.simulated:
            said = f"rig {config.name} is not simulated: its finger does what it likes"
            raise BadInputError("not_simulated", said, "leave --slide out")
        read_slide(slide)  # its errors are reported here
    limits, description = config.operating_limits(), load_model(model)
    surface = build_surface(description, limits)
    signs = config.limits.model or (PUBLISHED if description.is_fitted else model)
    signed = surface if signs == model else build_surface(load_model(signs), limits)
    return DaemonSettings(
        rig,
        model,
        config,
        surface,
        render_settings(config, surface, signed=signed),
        allow_no_rt,
        amplifier_record,
        slide=slide,
        signed=signed,
    )


def render_settings(
    config: RigConfig,
    surface: SurfaceFile,
    *,
    feedback: bool = True,
    signed: SurfaceFile | None = None,
) -> RenderSettings:
    """How to render on one rig, with nothing to render yet; positions are extrapolated by the whole
    latency. `signed` as for `tick_settings`.
    """
    envelope = not isinstance(config.analog_output, NoPart)
    lead_s, since_tick_s = _lead_s(config), _since_tick_s(config)
    usual_s = 2.0 * reports_of(config.finger_tracker).interval_s + SCHEDULING_S
    stages = tick_settings(
        config,
        surface,
        Nothing(),
        feedback_latency_s=since_tick_s if feedback else None,
        output_latency_s=since_tick_s,
        longest_age_s=usual_s,
        signed=signed,
    )
    standing = int(Flag.FRICTION_FROM_CURRENT) if config.friction_from_current else 0
    return RenderSettings(
        stages,
        envelope=envelope,
        lead_s=lead_s,
        period_s=TICK_S,
        usual_s=usual_s,
        standing_flags=standing,
        model_std=0.0 if config.without_force is None else LEVEL_STD,
        off_m=off_m(config),
    )


def placement_of(config: RigConfig, speed_m_s: float) -> Placement:
    """How far from a finger that slides at this speed the rig renders."""
    finger = finger_settings(config, _since_tick_s(config))
    return placement(finger, reports_of(config.finger_tracker), speed_m_s)


def at_turns_of(config: RigConfig, speed_m_s: float) -> tuple[float, float]:
    """The same beside turns of strokes back and forth: median, and what 95 % are within, m."""
    finger = finger_settings(config, _since_tick_s(config))
    return at_turns(finger, reports_of(config.finger_tracker), speed_m_s)


def off_m(config: RigConfig) -> float:
    """How far off a place is half of the time, at a usual speed."""
    return placement_of(config, USUAL_SPEED_M_S).median_m


def _lead_s(config: RigConfig) -> float:
    """What an envelope is written ahead, as far as a file says it."""
    output = config.analog_output
    return 0.0 if isinstance(output, NoPart) else output.lead_s or LEAST_LEAD_S


def _since_tick_s(config: RigConfig) -> float:
    """From a tick to what it does."""
    latency_s = latency_budget_s(config, TICK_S, _lead_s(config))
    return latency_s["total"] - latency_s["sensor"] - latency_s["tick"]


def latency_budget_s(config: RigConfig, period_s: float, lead_s: float) -> dict[str, float]:
    """Mean time from where the finger is to the voltage that belongs there, by where it is spent,
    and in all.

    Waiting for the next sensor reading, tick and set point takes half a period each.
    `output.latency_s` of the rig is measured from a command's wait to its effect. An envelope is
    written ahead by `lead_s`, of which the tick that writes it is yet to come. There
    `output.latency_s` is what the instruments take besides.
    """
    parts = {"sensor": 0.5 * reports_of(config.finger_tracker).interval_s, "tick": 0.5 * period_s}
    if isinstance(config.analog_output, NoPart):
        wait_s = 0.5 * config.output.setpoint_interval_s
        instrument_s = max(config.output.latency_s - wait_s, 0.0)
        parts |= {"set_point": wait_s, "instrument": instrument_s}
    else:
        ahead_s = max(lead_s - period_s, 0.0) + BEHIND_S
        parts |= {"envelope": ahead_s, "instrument": config.output.latency_s}
    return parts | {"total": sum(parts.values())}


def reach_hz(config: RigConfig) -> float:
    """The highest frequency of friction that the rig's output can make: half the rate at which it
    changes.
    """
    if isinstance(config.analog_output, NoPart):
        return 0.5 / config.output.setpoint_interval_s
    return 0.5 / TICK_S
