"""One tick: what happens between a finger and a voltage, in order. Start reading here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from haptic_driver.limits import OperatingLimits
from haptic_driver.render import controller, drive, finger, safety, texture
from haptic_driver.render.way import Way, follow
from haptic_driver.signals import (
    NO_COMMAND,
    DriveCommand,
    FingerSample,
    FingerState,
    OperatingPoint,
    SafeOperatingPoint,
    TargetFriction,
)


@dataclass(frozen=True)
class TickSettings:
    """The settings of the stages; replaced as a whole, never changed.

    `by_time`: the texture is met along the finger's way, one report late, instead of where the
    finger is expected.
    """

    finger: finger.FingerSettings
    texture: texture.Target
    controller: controller.Controller
    limits: OperatingLimits
    drive: drive.DriveSettings
    worst_case: safety.WorstTable
    by_time: bool = False


class TickState(NamedTuple):
    """What the stages remember from one tick to the next."""

    finger: finger.FingerTracking = finger.INITIAL
    way: Way | None = None
    controller: controller.ControllerState = controller.INITIAL
    safety: safety.SafetyState = safety.INITIAL
    drive: drive.DriveState = drive.INITIAL
    command: DriveCommand = NO_COMMAND


class Tick(NamedTuple):
    """Everything one tick decided, for the actuator and the record. `placed` is the finger where
    the texture is met.
    """

    finger: FingerState
    placed: FingerState
    target: TargetFriction
    wanted: OperatingPoint
    safe: SafeOperatingPoint
    command: DriveCommand


def tick(settings: TickSettings, state: TickState, sample: FingerSample) -> tuple[TickState, Tick]:
    """Finger -> target -> operating point -> safe point -> drive command."""
    tracking, felt = finger.track(settings.finger, state.finger, sample)
    way, placed = None, felt
    if settings.by_time:
        way, placed = follow(state.way, sample, felt, settings.finger.longest_age_s)
    target = texture.target(settings.texture, placed)
    control, wanted = settings.controller.step(state.controller, target, felt, state.command)
    worst = safety.Worst(
        *safety.worst_at(settings.worst_case, wanted.frequency_hz, wanted.voltage_v)
    )
    guard, safe = safety.gate(settings.limits, state.safety, wanted, worst)
    driven, command = drive.drive(settings.drive, state.drive, safe, felt.time_s)
    return TickState(tracking, way, control, guard, driven, command), Tick(
        felt, placed, target, wanted, safe, command
    )
