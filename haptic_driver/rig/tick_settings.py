"""From a rig's configuration and a surface to the stages of a tick."""

from __future__ import annotations

from haptic_driver.lookup.file import SurfaceFile, ready_for_lookup, with_areas
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.feedback import FeedbackSettings
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import table_of
from haptic_driver.render.texture import Target
from haptic_driver.render.tick import TickSettings
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.finger_trackers import reports_of
from model.description import ModelDescription
from model.touch_model import TouchModel


def tick_settings(
    config: RigConfig,
    file: SurfaceFile,
    texture: Target,
    *,
    feedback_latency_s: float | None = None,
    output_latency_s: float | None = None,
    longest_age_s: float = FingerSettings.longest_age_s,
    signed: SurfaceFile | None = None,
) -> TickSettings:
    """The stages of one rig, with a surface and a texture. Voltages are judged by the worst case of
    the surface, and of the `signed` one.

    `feedback_latency_s`: from a set point to its effect, for feedback from measured friction; None
    renders without. `output_latency_s`: by which the finger's position is extrapolated from a tick
    on; None takes the rig's. `longest_age_s`: up to which a reading is extrapolated to its tick.
    """
    limits = config.operating_limits()
    file = file if signed is None else file.protected_by(signed)
    model = TouchModel(ModelDescription.of(file.provenance["model"]))
    controller = ControllerSettings(
        with_areas(ready_for_lookup(file, limits), model),
        limits,
        **config.controller.model_dump(),
        correction=file.correction,
        feedback=None if feedback_latency_s is None else _law(config, feedback_latency_s),
    )
    latency_s = config.output.latency_s if output_latency_s is None else output_latency_s
    return TickSettings(
        finger_settings(config, latency_s, longest_age_s),
        texture,
        Controller(controller),
        limits,
        DriveSettings(config.output.voltage_rise_v_per_s),
        table_of(file.worst_case(limits)),
    )


def finger_settings(
    config: RigConfig, output_latency_s: float, longest_age_s: float = FingerSettings.longest_age_s
) -> FingerSettings:
    """The finger's stage of a rig, which knows how its tracker reports."""
    reports = reports_of(config.finger_tracker)
    return FingerSettings(
        contact_on_n=config.finger.contact_on_n,
        contact_off_n=config.finger.contact_off_n,
        output_latency_s=output_latency_s,
        longest_age_s=longest_age_s,
        position_noise_m=reports.noise_m,
        report_jitter_s=reports.jitter_s,
    )


def _law(config: RigConfig, latency_s: float) -> FeedbackSettings:
    measures = config.without_force is None
    return FeedbackSettings(latency_s, off_share=1.0 if measures else 0.0)
