"""A rig's file as its drivers reach the simulated devices that `ServedRig` serves."""

from __future__ import annotations

from collections.abc import Mapping

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.part import NO_WATCHDOG, DeviceSection, NoPart
from haptic_driver.rig.parts.amplifiers import AmplifierConfig, AnalogAmplifierConfig
from haptic_driver.rig.parts.finger_trackers import StageFingerConfig
from haptic_driver.rig.parts.force_sensors import NetFtForceSensorConfig
from haptic_driver.rig.parts.generators import WatchdogConfig
from haptic_driver.rig.parts.interlocks import InterlockBox, NoInterlock
from haptic_driver.rig.parts.load_stages import Lts150LoadStageConfig, SimulatedLoadStageConfig
from haptic_driver.rig.parts.stages import Lts150StageConfig
from haptic_driver.rig.roles import APART, ROLES
from hw.force.net_ft_server import SCALE
from model.support.toml import toml_lines

# a simulated generator that is gone will not come back at the same address
WATCHDOG_GIVE_UP_S = 1.0
HERE = "/dev/null"  # stands for an address until the device is served
LOAD_STAGE = SimulatedLoadStageConfig(kind="simulated")
FACE_M = 2e-3  # from where a load stage stands clear to the finger
LINES = "voltage_monitor", "current_monitor", "fault_line"
FORCE_BOX = NetFtForceSensorConfig(
    kind="net_ft", host=HERE, **SCALE._asdict(), normal_axis="-z", lateral_axis="x"
)
STAGE = Lts150StageConfig(
    resource=HERE,
    travel_m=[0.0, 0.15],
    velocity_m_s=0.02,
    acceleration_m_s2=0.02,
    velocity_limit_m_s=0.05,
    acceleration_limit_m_s2=0.05,
)


def as_real(config: RigConfig) -> RigConfig:
    """A simulated rig as the file of a real one would say it: stage, force box, interlock box and a
    watchdog over it.
    """
    none = config.without_force
    if none is not None:
        none = none.model_copy(update={"stray_capacitance_f": config.stray_capacitance_f})
    return config.model_copy(
        update={
            "simulated": False,
            "twin": True,
            "electrode_monitors": [] if none is None else config.electrode_monitors,
            "camera": NoPart(),
            "load_stage": NoPart(),
            "waveform_generator": config.waveform_generator.served_at(HERE),
            "interlock": InterlockBox(kind="box", resource=HERE),
            "watchdog": WatchdogConfig(generator=HERE, interlock=HERE),
            "force_sensor": none or FORCE_BOX,
            "stage": STAGE,
            "finger_tracker": StageFingerConfig(kind="stage", origin_m=[0.0, 0.03]),
        }
    )


def twin_of(config: RigConfig) -> tuple[RigConfig, list[str]]:
    """A real rig without what cannot be served, and what that is, by key and kind.

    A force box stands in for another force sensor, since no rig is without. Where the card goes,
    the amplifier's lines on it go too.
    """
    left_out = {
        key: f"{key}: no simulator of kind {getattr(section, 'kind', section)}"
        for key, section in config.devices
        if not (section.served_as or section.is_simulated is None)
    }
    gone = {key.partition(".")[0] for key in left_out}
    changed: dict[str, object] = {key: RigConfig.model_fields[key].default for key in gone}
    if "electrode_monitors" in gone:
        changed["electrode_monitors"] = [one for one in config.electrode_monitors if one.served_as]
    if "interlock" in gone:
        changed["interlock"] = NoInterlock(kind="none")
    if "force_sensor" in gone:
        changed["force_sensor"] = FORCE_BOX
        left_out["force_sensor"] += "; a Net F/T box stands in"
    if "analog_inputs" in gone:
        changed["amplifier"] = config.amplifier.model_copy(update=dict.fromkeys(LINES))
    if config.watchdog is not None and config.watchdog.interlock and "interlock" in gone:
        changed["watchdog"] = config.watchdog.model_copy(update={"interlock": None})
    named = {"name": config.name, "twin": True, **changed}
    return config.model_copy(update=named), list(left_out.values())


def copy_of(config: RigConfig) -> tuple[RigConfig, list[str]]:
    """A rig of which every device can be a simulated one, and what of a real one is left out.

    Its amplifier has the figures alone: a card's lines, and kinds of one's own, reach hardware.
    """
    if config.simulated:
        return config, []
    twin, left_out = twin_of(config)
    figures = {key: getattr(twin.amplifier, key) for key in AmplifierConfig.model_fields}
    figures |= {"kind": "analog", **dict.fromkeys(LINES)}
    plain = AnalogAmplifierConfig.model_construct(**figures)
    return twin.model_copy(update={"amplifier": plain}), left_out


def reached(config: RigConfig, endpoints: Mapping[str, str]) -> RigConfig:
    """The same rig where its devices are served. A simulated one that is not served is left out."""
    changed: dict[str, object] = {"watchdog": _watchdog(config, endpoints)}
    for key in ROLES:
        found = [_found(key, section, endpoints) for section in config.sections_of(key)]
        here = [section for section in found if section is not None]
        absent = RigConfig.model_fields[key].default
        changed[key] = here if isinstance(absent, list) else next(iter(here), absent)
    return config.model_copy(update=changed)


def file_of(config: RigConfig) -> str:
    """A rig's file that says the same, without what it leaves to the defaults."""
    said = config.model_dump(exclude_unset=True, exclude_none=True)
    tables = {key: said.pop(key) for key, one in [*said.items()] if isinstance(one, dict)}
    filled = {key: toml_lines(one) for key, one in tables.items() if one}
    return toml_lines(said) + "".join(f"\n[{key}]\n{one}" for key, one in filled.items())


def pressing(config: RigConfig) -> SimulatedLoadStageConfig:
    """What is behind a rig's load stage: its own simulation, or a finger near where it begins."""
    match config.load_stage:
        case SimulatedLoadStageConfig() as section:
            return section
        case Lts150LoadStageConfig(clear_m=clear_m) as section:
            face_m = clear_m + section.mounting().towards * FACE_M
            same = section.model_dump(exclude={"kind", "resource"})
            return SimulatedLoadStageConfig(kind="simulated", face_m=face_m, **same)
    return LOAD_STAGE


def _found(key: str, section: DeviceSection, endpoints: Mapping[str, str]) -> DeviceSection | None:
    if where := endpoints.get(section.served_as):
        return section.served_at(where)
    is_gone = section.is_simulated and ROLES[key].opens is not APART
    return None if is_gone else section


def _watchdog(config: RigConfig, endpoints: Mapping[str, str]) -> WatchdogConfig | None:
    """The rig's own, or one that a simulated rig has no section for."""
    own, generator = config.watchdog, endpoints["waveform_generator"]
    if config.waveform_generator.is_simulated:
        return WatchdogConfig(generator=generator, give_up_s=WATCHDOG_GIVE_UP_S)
    if own is None or own.generator == NO_WATCHDOG:
        return own
    interlock = own.interlock and endpoints["interlock_tcp"]
    return own.model_copy(update={"generator": generator, "interlock": interlock})
