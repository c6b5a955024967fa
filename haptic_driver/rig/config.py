"""What a rig's file may say: one class per section, every range where the value is read.

Real devices have no defaults for what only the lab can know. Sections whose figures decide about
safety carry `measured_by` and `measured_at`. `RigConfig.unverified` lists what still lacks them,
and a rig refuses to come on until the list is empty.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, FiniteFloat, WithJsonSchema, model_validator
from pydantic.json_schema import SkipJsonSchema

from haptic_driver.base.units import readable
from haptic_driver.config import Section, Within, find_config, parse
from haptic_driver.errors import BadInputError
from haptic_driver.limits import ICNIRP_PUBLIC_A_RMS, OperatingLimits
from haptic_driver.render.policies import POLICIES
from haptic_driver.rig.part import (
    NO_WATCHDOG,
    SIMULATED,
    DeviceSection,
    DirectVolts,
    Farads,
    ForceRange,
    Hertz,
    LoadNewtons,
    NoPart,
    Patience,
    SignedFigures,
    Volts,
)
from haptic_driver.rig.parts.electrode_monitors import (
    CardElectrodeMonitorConfig,
    SomeElectrodeMonitor,
)
from haptic_driver.rig.parts.event_lines import EventCodes
from haptic_driver.rig.parts.force_sensors import NoForceSensorConfig
from haptic_driver.rig.parts.generators import WatchdogConfig
from haptic_driver.rig.parts.interlocks import InterlockBox
from haptic_driver.rig.roles import ROLES, RigParts
from haptic_driver.rig.sealed import opened
from hw.analog.demodulation import highest_carrier_hz
from hw.generator import contract as generators
from hw.generator.analog_carrier.driver import SAMPLES_PER_PERIOD
from model.support.errors import nearest
from model.support.reading import read_toml

# What two programs can hold at the same time; the watchdog must not depend on the driver letting
# go.
_SHAREABLE = re.compile(r"TCPIP\d*::.*", re.IGNORECASE)


def _known_policy(name: str) -> str:
    if name not in POLICIES:
        raise ValueError(f"there is no policy '{name}'. {nearest(name, list(POLICIES))}")
    return name


Policy = Annotated[
    str, AfterValidator(_known_policy), WithJsonSchema({"type": "string", "enum": [*POLICIES]})
]


# Table 5 of ICNIRP 2010, Health Phys. 99:818: contact current, occupational, is twice that of the
# general public.
ICNIRP_OCCUPATIONAL_A_RMS = tuple((f, 2.0 * i) for f, i in ICNIRP_PUBLIC_A_RMS)
ROUNDING = 1.0 + 1e-9

CurvePoint = Annotated[
    list[
        Annotated[
            float,
            Within(1e-9, 1e9, "it is neither a frequency in Hz nor a current in A that flows here"),
        ]
    ],
    Field(min_length=2, max_length=2),
]


TouchingArea = Annotated[
    float, Within(1e-5, 0.05, "a fingertip touches with more, and two hands with less")
]


class LimitsConfig(SignedFigures):
    """What the rig allows at the electrode; see `OperatingLimits`."""

    voltage_v: Volts = Field(
        description="highest peak amplitude, offset included; not above amplifier.voltage_limit_v"
    )
    frequency_hz: Annotated[list[Hertz], Field(min_length=2, max_length=2)] = Field(
        default=[1.0, 1e6],
        description=(
            "[lowest, highest] carrier; with monitors on a card at most 0.4 of its sampling rate"
        ),
    )
    contact_current_a_rms: Annotated[list[CurvePoint], Field(min_length=1)] = Field(
        default=[list(point) for point in ICNIRP_PUBLIC_A_RMS],
        description="[Hz, A rms], rising in Hz",
    )
    direct_voltage_v: DirectVolts = Field(
        default=0.0,
        description=(
            "steady voltage, bias included; 0 until somebody knows what finger and screen bear"
        ),
    )
    series_resistance_ohm: Annotated[
        float,
        Within(0.0, 10e6, "through more, an electrode of 100 pF follows no carrier above 160 Hz"),
    ] = Field(
        default=0.0,
        description="in the electrode's lead; bounds the current of the worst case; 0: unknown",
    )
    panel_capacitance_f: Farads = Field(
        default=0.0,
        description=(
            "panel, wiring and amplifier output together; the current to charge it is checked"
        ),
    )

    touching_area_m2: TouchingArea | None = Field(
        default=None,
        description=(
            "most contact at a time that the limit of current holds for, in all; one finger has"
            " 88e-6 (median of 10 people), a hand's fingers 471e-6 (95 %) and 684e-6 at most, a"
            " palm 9e-3; docs/safety.md"
        ),
    )
    model: str = Field(
        default="",
        description=(
            "by whose worst case voltages are judged, beside the model that is rendered by; the"
            " daemon's first if left out, or `reference` where that is a fit"
        ),
    )

    @model_validator(mode="after")
    def _ordered(self) -> LimitsConfig:
        if self.frequency_hz[0] >= self.frequency_hz[1]:
            raise ValueError("frequency_hz must be [lowest, highest]")
        frequencies = [f for f, _ in self.contact_current_a_rms]
        if frequencies != sorted(set(frequencies)):
            raise ValueError("contact_current_a_rms must rise in frequency")
        return self

    @model_validator(mode="after")
    def _bearable(self) -> LimitsConfig:
        """Both curves are straight between their points, so that these are all that has to be
        compared.
        """
        low_hz, high_hz = self.frequency_hz
        curve = tuple((f, i) for f, i in self.contact_current_a_rms)
        own = OperatingLimits(self.voltage_v, low_hz, high_hz, contact_current_a_rms=curve)
        highest = replace(own, contact_current_a_rms=ICNIRP_OCCUPATIONAL_A_RMS)
        for frequency_hz in sorted(f for f, _ in (*curve, *ICNIRP_OCCUPATIONAL_A_RMS)):
            current_a = own.contact_current_limit_a_rms(frequency_hz)
            most_a = highest.contact_current_limit_a_rms(frequency_hz)
            if current_a > most_a * ROUNDING:
                allowed, most = (readable(float(a), "A") for a in (current_a, most_a))
                raise ValueError(
                    f"contact_current_a_rms allows {allowed} at {frequency_hz:g} Hz, more than"
                    f" {most}, the reference level of ICNIRP 2010 for workers"
                )
        return self


class SafetySettings(Section):
    """When the rig stops trusting its caller or its devices.

    All figures are judged, none is from a source but the lease (500 ms, `electrovibration-exp`).
    """

    lease_s: Patience = Field(
        default=0.5, description="output that is not refreshed for so long goes to zero"
    )
    beat_interval_s: Patience = Field(
        default=0.05,
        description="heartbeats of interlock box and watchdog are at least so far apart",
    )
    settle_s: Patience = Field(
        default=0.15, description="how long a set point may take to show on the voltage monitor"
    )
    monitor_tolerance: Annotated[
        float,
        Within(1e-6, 0.5, "a monitor that is off by half tells nothing of what was commanded"),
    ] = Field(
        default=0.1, description="a share of the commanded voltage by which the monitor may differ"
    )
    monitor_tolerance_v: Annotated[
        float, Within(1e-6, 50.0, "a finger feels as much, and what is left on would not be seen")
    ] = Field(default=5.0, description="or so many volts at the electrode, whichever is more")
    off_retry_s: Patience = Field(
        default=0.5, description="between attempts to get an output off that did not say so"
    )


class OutputConfig(Section):
    """How commands reach the electrode."""

    setpoint_interval_s: Annotated[
        float,
        Within(
            0.001,
            1.0,
            "the tick is no faster, and a voltage that waits for longer is another finger's",
        ),
    ] = Field(default=0.010, description="an amplitude is written over SCPI at most so often")
    latency_s: Annotated[float, Within(0.0, 1.0, "no finger's place is known so far ahead")] = (
        Field(
            default=0.0,
            description="from a finger sample to its effect: the position is extrapolated by it",
        )
    )
    voltage_rise_v_per_s: Annotated[
        float,
        Within(
            1.0, 1e6, "from nothing to the highest voltage of all within a tick, 1 ms, is no rise"
        ),
    ] = Field(default=10e3, description="never faster")
    linger_s: Annotated[
        float, Within(0.0, 60.0, "without a finger nothing is kept on for longer")
    ] = Field(
        default=10.0,
        description=(
            "so long after the finger has left, or nothing is asked, the output stays"
            " on at its lowest"
        ),
    )


ScreenSide = Annotated[float, Within(1e-3, 2.0, "no touch screen is smaller or larger")]


class ScreenConfig(Section):
    """How large the touch screen is, from its corner at x = y = 0; a finger farther off is not
    believed.

    The usual size is that of the largest touch screens.
    """

    width_m: ScreenSide = Field(default=0.6, description="along x")
    height_m: ScreenSide = Field(default=0.4, description="along y")
    margin_m: Annotated[float, Within(0.0, 0.05, "no fingertip is wider")] = Field(
        default=0.01, description="so far beyond an edge a finger may be reported"
    )


class FingerConfig(Section):
    """How the finger is read."""

    contact_on_n: LoadNewtons = Field(
        default=0.15, description="above the wobble of an unloaded force sensor"
    )
    contact_off_n: LoadNewtons = Field(default=0.10, description="the finger has left below")
    # in older files, and not used: the filter follows the panel
    velocity_time_constant_s: SkipJsonSchema[
        Annotated[float, Within(0.0, 10.0, "no finger was smoothed for longer")] | None
    ] = None


class ControllerConfig(Section):
    """How operating points are chosen when the user does not say."""

    policy: Policy = Field(
        default="max_authority", description="how the carrier is chosen: docs/carrier.md"
    )
    fixed_frequency_hz: Hertz | None = Field(default=None, description="for that policy")
    lowest_carrier_hz: Hertz = Field(
        default=100.0, description="the force pulses at twice the carrier"
    )
    quiet_above_hz: Hertz = Field(
        default=1000.0, description="from here on that ripple counts as not felt: docs/carrier.md"
    )
    hysteresis: Annotated[float, Within(0.0, 1.0, "it is a share")] = Field(
        default=0.05, description="how much better another frequency must be"
    )


Latency = Annotated[float, Within(0.0, 1.0, "no generator takes longer")]


def _can_be_opened(sealed: str) -> str:
    opened(sealed)
    return sealed


class SimulationConfig(Section):
    """How the simulated instruments and finger behave."""

    amplitude_latency_s: Latency = Field(
        default=0.030, description="of the simulated generator, for a new amplitude"
    )
    frequency_latency_s: Latency = Field(default=0.003, description="the same, for a new frequency")
    friction_cutoff_hz_per_mm_s: Annotated[
        float, Within(1e-3, 1e6, "no friction follows slower or faster")
    ] = Field(default=13.8, description="arXiv 2505.11162")
    force_noise_n: Annotated[float, Within(0.0, 10.0, "no finger is detected in more noise")] = (
        Field(default=0.003, description="1 sigma per reading and channel")
    )
    force_range_n: ForceRange = Field(
        default=20.0, description="where the simulated force sensor saturates"
    )
    seed: int = Field(default=1, description="of the noise")
    stray_capacitance_f: Farads = Field(
        default=0.0, description="of electrode and leads, beside the touch"
    )
    model: str | None = Field(
        default=None,
        description="the finger's own model, by name or path; none: the one that drives the rig",
    )
    hide: dict[str, dict[str, FiniteFloat]] = Field(
        default={}, description="effects, by name with their parameters, that only the finger has"
    )
    sealed: Annotated[str, AfterValidator(_can_be_opened)] = Field(
        default="",
        description="more that only the finger has, packed by `haptic exercise`: docs/course.md",
    )


SIMULATED_PARTS = "interlock", "force_sensor", "finger_tracker"


class RigConfig(RigParts):
    """One rig, as its file in `configs/rigs/` says."""

    name: str = Field(
        default="",
        description="shown in every status, record and log line; by default the file's own name",
    )
    simulated: bool = Field(description='true only with waveform_generator.resource = "simulated"')
    twin: bool = Field(
        default=False,
        description="its instruments are simulators, reached as real ones: haptic simulate --like",
    )
    limits: LimitsConfig
    safety: SafetySettings = SafetySettings()
    watchdog: WatchdogConfig | None = None
    event_codes: EventCodes = EventCodes()
    screen: ScreenConfig = ScreenConfig()
    output: OutputConfig = OutputConfig()
    finger: FingerConfig = FingerConfig()
    controller: ControllerConfig = ControllerConfig()
    simulation: SimulationConfig = SimulationConfig()
    adapt: bool = Field(
        default=False,
        description=(
            "refit the finger's model while rendering, from the daemon's start on, as "
            "`haptic adapt on` does"
        ),
    )

    @model_validator(mode="before")
    @classmethod
    def _simulated_parts(cls, said: Any) -> Any:
        """What a simulated rig has where its file says nothing of it."""
        if isinstance(said, dict) and said.get("simulated") is True:
            return {key: {"kind": SIMULATED} for key in SIMULATED_PARTS} | said
        return said

    @model_validator(mode="after")
    def _consistent(self) -> RigConfig:
        for contradiction in _contradictions(self):
            raise ValueError(contradiction)
        return self

    @property
    def is_computed(self) -> bool:
        """Whether what it measures is computed; every record says so."""
        return self.simulated or self.twin

    @property
    def signed_sections(self) -> dict[str, SignedFigures]:
        """The sections whose figures somebody has to sign as measured, by name in the file."""
        return dict(_signed(self))

    @property
    def unverified(self) -> list[str]:
        """What keeps the rig from coming on: safety figures that nobody has signed as measured, and
        undecided settings.
        """
        missing = [
            f"{name}.measured_by and measured_at"
            for name, section in self.signed_sections.items()
            if not section.verified
        ]
        if self.limits.touching_area_m2 is None and not self.simulated:
            missing.append("limits.touching_area_m2 (its limits hold for one touch alone)")
        if self.watchdog is None and not self.waveform_generator.is_simulated:
            missing.append('watchdog.generator (a resource, or "none")')
        if self.interlock is None:
            missing.append('interlock.kind ("none" where there is none)')
        return missing

    def addresses_of(self, key: str) -> list[str]:
        """Where the instruments of a role are."""
        return [address for section in self.sections_of(key) for address in section.addresses]

    @property
    def addresses(self) -> list[str]:
        """Of every instrument that one program at a time may open."""
        return [address for key in ROLES for address in self.addresses_of(key)]

    @property
    def monitors(self) -> dict[str, str]:
        """Which lines of the amplifier are read, and where."""
        return {name: at for _, section in self.devices for name, at in section.monitors.items()}

    @property
    def monitor_reach_hz(self) -> float:
        """The highest carrier that the amplifier's monitors show; a card would alias a higher
        one.
        """
        monitors = self.amplifier.voltage_monitor, self.amplifier.current_monitor
        if self.analog_inputs is None or not any(monitors):
            return inf
        return highest_carrier_hz(self.analog_inputs.sample_rate_hz)

    def electrode_monitor(self, frequency_hz: float, sweep: bool = False) -> int | None:
        """Which of the electrode's monitors, the first of the file that measures a carrier; None
        for none of them.

        One that drives the electrode itself reads nothing but sweeps.
        """
        for i, monitor in enumerate(self.electrode_monitors):
            if monitor.drives and not sweep:
                continue
            lowest_hz, highest_hz = monitor.range_hz(self.card_hz)
            if lowest_hz <= frequency_hz <= highest_hz:
                return i
        return None

    @property
    def friction_from_current(self) -> bool:
        """Whether nothing measures force, something reads the electrode while it is driven, and it
        is known what of its current flows beside the finger.
        """
        reads = not all(monitor.drives for monitor in self.electrode_monitors)
        return self.without_force is not None and reads and self.stray_capacitance_f is not None

    @property
    def without_force(self) -> NoForceSensorConfig | None:
        """What stands in for a force sensor where the rig has none."""
        given = self.force_sensor
        return given if isinstance(given, NoForceSensorConfig) else None

    @property
    def stray_capacitance_f(self) -> float | None:
        """What is beside the finger on a rig without a force sensor; None where nobody says."""
        given = self.without_force
        if given is None or given.stray_capacitance_f is not None:
            return None if given is None else given.stray_capacitance_f
        return self.simulation.stray_capacitance_f if self.simulated else None

    @property
    def card_hz(self) -> tuple[float, float]:
        """The lowest and the highest carrier that the card's channels of the monitors tell."""
        card = self.analog_inputs
        return (inf, 0.0) if card is None else (1.0 / card.buffer_s, self.monitor_reach_hz)

    def swept_by_meter(self, frequency_hz: float) -> SomeElectrodeMonitor | None:
        """The instrument that drives the electrode itself in a sweep at this carrier, if one
        does.
        """
        i = self.electrode_monitor(frequency_hz, sweep=True)
        monitor = None if i is None else self.electrode_monitors[i]
        return monitor if monitor is not None and monitor.drives else None

    def generator_kind(self) -> generators.GeneratorKind:
        """The installed kind of waveform generator; BadInputError where its package cannot be
        loaded.
        """
        try:
            return generators.generator_kind(self.waveform_generator.model)
        except ValueError as error:
            raise BadInputError(
                "bad_generator", str(error), "repair or install the package that brings it"
            ) from error

    def operating_limits(self) -> OperatingLimits:
        """The limits as the controller and the safety gate use them; no carrier that the monitors
        would alias.
        """
        highest_hz = min(self.limits.frequency_hz[1], self.monitor_reach_hz)
        return replace(self.sweep_limits(), frequency_high_hz=highest_hz)

    def sweep_limits(self) -> OperatingLimits:
        """The same as far as any monitor reaches: beyond the card's reach for voltages that read as
        quiet anyway.
        """
        limits = self.limits
        return OperatingLimits(
            voltage_v=limits.voltage_v,
            frequency_low_hz=limits.frequency_hz[0],
            frequency_high_hz=limits.frequency_hz[1],
            slew_v_per_s=self.amplifier.slew_limit_v_per_s,
            contact_current_a_rms=tuple((f, i) for f, i in limits.contact_current_a_rms),
            series_resistance_ohm=limits.series_resistance_ohm,
            amplifier_current_a=self.amplifier.current_limit_a,
            panel_capacitance_f=limits.panel_capacitance_f,
            touching_area_m2=limits.touching_area_m2 or 0.0,
        )


def _signed(section: Section, above: str = "") -> Iterator[tuple[str, SignedFigures]]:
    """Wherever they stand in the file."""
    for key in type(section).model_fields:
        said = getattr(section, key)
        for i, one in enumerate(said if isinstance(said, list) else [said]):
            path = f"{above}{key}.{i}" if isinstance(said, list) else f"{above}{key}"
            if isinstance(one, SignedFigures):
                yield path, one
            if isinstance(one, Section):
                yield from _signed(one, f"{path}.")


def load_rig(name_or_path: str) -> RigConfig:
    """A rig by the name of its file in `configs/rigs/`, or by path."""
    path = find_config(name_or_path, "rigs")
    said = {"name": path.stem} | read_toml(path)
    return _with_whole_paths(parse(RigConfig, said, str(path)), path.parent)


def _with_whole_paths(rig: RigConfig, folder: Path) -> RigConfig:
    """Files that a rig's file names are looked for beside it."""
    changed: dict[str, object] = {}
    for key in ROLES:
        said = getattr(rig, key)
        whole = [_beside(section, folder) for section in rig.sections_of(key)]
        changed[key] = whole if isinstance(said, list) else next(iter(whole), None)
    return rig.model_copy(update=changed)


def _beside(section: DeviceSection, folder: Path) -> DeviceSection:
    named = {key: getattr(section, key) for key in section.files}
    return section.model_copy(
        update={key: str(folder / said) for key, said in named.items() if said}
    )


def _contradictions(rig: RigConfig) -> Iterator[str]:
    """What two sections of one file cannot both say."""
    if rig.limits.voltage_v > rig.amplifier.voltage_limit_v:
        yield (
            f"limits.voltage_v {rig.limits.voltage_v:g} is above amplifier.voltage_limit_v "
            f"{rig.amplifier.voltage_limit_v:g}"
        )
    if rig.finger.contact_off_n > rig.finger.contact_on_n:
        yield "finger.contact_off_n is above finger.contact_on_n"
    yield from _shared(rig)
    yield from _mixed_with_simulation(rig)
    yield from _not_watched(rig)
    yield from _not_wired(rig)


def _shared(rig: RigConfig) -> Iterator[str]:
    """One program holds a port once."""
    named: dict[str, str] = {}
    for key in ROLES:
        for address in set(rig.addresses_of(key)):
            if other := named.get(address):
                yield f"{other} and {key} both name {address}: each needs a port of its own"
            named[address] = key


def _mixed_with_simulation(rig: RigConfig) -> Iterator[str]:
    for key, section in rig.devices:
        if section.is_simulated not in (None, rig.simulated):
            told = f"{key}.{section.told_by}"
            yield f"simulated and {told} disagree about whether this rig is simulated"
    if rig.simulated and rig.watchdog is not None and rig.watchdog.generator != NO_WATCHDOG:
        yield "watchdog: a simulated rig has no such real device"


def _not_watched(rig: RigConfig) -> Iterator[str]:
    """A watchdog that waits for the driver to let go of a port watches nothing."""
    watchdog, interlock = rig.watchdog, rig.interlock
    if watchdog is None or watchdog.generator == NO_WATCHDOG:
        return
    if watchdog.period_s < rig.safety.lease_s:
        yield (
            f"watchdog.period_s {watchdog.period_s:g} is below safety.lease_s"
            f" {rig.safety.lease_s:g}: it would switch off a rig that is only slow"
        )
    held = [
        rig.waveform_generator.resource,
        interlock.resource if isinstance(interlock, InterlockBox) else None,
    ]
    if watchdog.generator.startswith("card:sound:"):
        yield (
            f"watchdog.generator: {watchdog.generator} is a sound card, which one program alone can"
            f' take: say "{NO_WATCHDOG}", and have an interlock box switch off'
        )
    for name, own in (("generator", watchdog.generator), ("interlock", watchdog.interlock)):
        if (
            own is not None
            and not own.startswith("card:")  # its driver gone, nobody holds it
            and not _SHAREABLE.fullmatch(own)
            and own.upper() in [h.upper() for h in held if h]
        ):
            yield (
                f"watchdog.{name}: {own} is held by the driver and cannot be opened twice; give the"
                " watchdog a "
                f'connection of its own (LAN), or say generator = "{NO_WATCHDOG}"'
            )


def _not_wired(rig: RigConfig) -> Iterator[str]:
    monitors = [rig.amplifier.voltage_monitor, rig.amplifier.current_monitor]
    parts = [section for _, section in rig.devices]
    readers = " and ".join(key for key, section in rig.devices if section.channels)
    if rig.analog_inputs is None and readers:
        yield f"{readers}: channels of a card, and there is no section [analog_inputs]"
    on_card = any(
        isinstance(monitor, CardElectrodeMonitorConfig) for monitor in rig.electrode_monitors
    )
    if on_card and not (rig.analog_inputs and all(monitors)):
        yield (
            'electrode_monitors: kind = "card" reads amplifier.voltage_monitor and'
            " amplifier.current_monitor: name both, and the card"
        )
    if any(monitors) and rig.analog_inputs is not None:
        window_s, carrier_hz = rig.analog_inputs.monitor_window_s, rig.controller.lowest_carrier_hz
        if window_s * carrier_hz < 1.0:
            yield (
                f"analog_inputs.monitor_window_s {window_s:g} is shorter than a period of"
                f" controller.lowest_carrier_hz {carrier_hz:g}: the monitor would miss the peak"
            )
        if window_s >= rig.safety.settle_s:
            yield (
                f"analog_inputs.monitor_window_s {window_s:g} is not below safety.settle_s"
                f" {rig.safety.settle_s:g}"
            )
    yield from _on_several_cards(rig)
    yield from _by_samples(rig)
    yield from _aliased(rig)
    if any(part.needs_stage for part in parts) and rig.stage is None:
        yield f'finger_tracker.kind is "{rig.finger_tracker.kind}", and there is no section [stage]'
    measured = rig.force_sensor is not None and rig.without_force is None
    if rig.load_stage.kind != "none" and not measured:
        yield "load_stage: nothing measures the load that it is to hold; add a [force_sensor]"
    modulation = rig.waveform_generator.modulation_input
    if isinstance(rig.analog_output, NoPart):
        return
    if not rig.generator_kind().external_modulation:
        model = rig.waveform_generator.model
        yield (
            f"analog_output: {model} is not modulated from outside by its driver; leave the"
            " section out"
        )
    if modulation is None:
        yield (
            "analog_output needs waveform_generator.modulation_input: what a level there does to"
            " the amplitude"
        )
    elif rig.analog_output.zero_level_v != -modulation.full_scale_v:
        yield (
            f"analog_output.zero_level_v {rig.analog_output.zero_level_v:g} is not"
            f" -waveform_generator.modulation_input.full_scale_v {-modulation.full_scale_v:g}: at 0"
            " V the amplitude is half its highest"
        )


def _on_several_cards(rig: RigConfig) -> Iterator[str]:
    """Cards have clocks of their own: values derived from samples of one instant come from one
    card.
    """
    amplifier = rig.amplifier.channels
    together = {
        "force_sensor.gauges": [] if rig.force_sensor is None else rig.force_sensor.channels
    }
    for i, monitor in enumerate(rig.electrode_monitors):
        if isinstance(monitor, CardElectrodeMonitorConfig):
            together[f"electrode_monitors.{i}"] = [*amplifier, *monitor.channels]
    for name, channels in together.items():
        cards = sorted({channel.partition("/")[0] for channel in channels})
        if len(cards) > 1:
            yield f"{name}: {', '.join(cards)} have clocks of their own; take channels of one card"
    used = {channel for _, part in rig.devices for channel in part.channels}
    unused = sorted(set(getattr(rig.analog_inputs, "terminals", ())) - used)
    if unused:
        yield f"analog_inputs.terminals: {', '.join(unused)} is read by nothing in this file"


def _by_samples(rig: RigConfig) -> Iterator[str]:
    """A carrier that an analog output makes, or a generator that has words for it."""
    generator = rig.waveform_generator
    carrier, is_card = generator.carrier, generator.resource.startswith("card:")
    if not (carrier or is_card or generator.model == "analog_carrier"):
        return  # and no kind is loaded for the question
    if not rig.generator_kind().by_samples:
        yield f"waveform_generator.carrier: {generator.model} makes its carrier itself"
        return
    if carrier is None:
        yield f"waveform_generator: {generator.model} needs a section [waveform_generator.carrier]"
        return
    if not (is_card or generator.resource == SIMULATED):
        yield 'waveform_generator.resource: an analog output is named as "card:ni:Dev1/ao0"'
    if not isinstance(rig.analog_output, NoPart):
        yield "analog_output: the carrier has its envelope already; leave the section out"
    if rig.limits.voltage_v > carrier.peak_v * rig.amplifier.gain_v_per_v * ROUNDING:
        yield (
            f"limits.voltage_v {rig.limits.voltage_v:g} is beyond waveform_generator.carrier.peak_v"
            f" times the amplifier's gain, {carrier.peak_v * rig.amplifier.gain_v_per_v:g}"
        )
    if rig.limits.frequency_hz[1] * SAMPLES_PER_PERIOD > carrier.sample_rate_hz * ROUNDING:
        yield (
            f"limits.frequency_hz goes up to {rig.limits.frequency_hz[1]:g}, with fewer than"
            f" {SAMPLES_PER_PERIOD} samples a period: let it end at"
            f" {carrier.sample_rate_hz / SAMPLES_PER_PERIOD:g}"
        )


def _aliased(rig: RigConfig) -> Iterator[str]:
    """A carrier beyond the card's reach may read as nothing, which is no evidence of nothing.

    A faster monitor sees it, but cannot trip: there the rig allows no more than what reads as quiet
    anyway.
    """
    highest_hz = rig.limits.frequency_hz[1]
    reach_hz = max(
        [
            rig.monitor_reach_hz,
            *(monitor.range_hz(rig.card_hz)[1] for monitor in rig.electrode_monitors),
        ]
    )
    if rig.analog_inputs is not None and highest_hz > reach_hz:
        rate_hz, reach_hz = rig.analog_inputs.sample_rate_hz, rig.monitor_reach_hz
        yield (
            f"analog_inputs.sample_rate_hz {rate_hz:g} aliases carriers above {reach_hz:g} Hz,"
            " which the monitors may then read as nothing, and limits.frequency_hz goes up to"
            f" {highest_hz:g}: let it end at {reach_hz:g}, or sample at"
            f" {highest_hz / reach_hz * rate_hz:g} or faster, or name a faster one in"
            " [[electrode_monitors]]"
        )
