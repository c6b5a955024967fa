"""What sections of a rig's file are made of, and how a kind of part makes itself known.

A package adds a kind by an entry point of one of the groups below that names a `PartKind`. The
entry point's name is the value of `kind` in a rig's file. A kind is loaded where a rig names it,
and by no other rig.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, TypeVar, cast, get_args

from pydantic import (
    AfterValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
)
from pydantic_core import (
    CoreSchema,
    InitErrorDetails,
    PydanticCustomError,
    PydanticKnownError,
    core_schema,
)

from haptic_driver.config import Kinds, Section, Within
from haptic_driver.rig.check import Checks, Examination
from hw import plugins
from hw.analog.cards import check_name
from hw.setting import Setting

if TYPE_CHECKING:
    from hw.analog.lines import AnalogInput, DigitalInput, DigitalOutput
    from hw.analog.ni_daq import NiCards
    from hw.monitor.lines import MonitorLines
    from hw.stage.lts150 import Lts150

AMPLIFIERS = "haptic_driver.amplifiers"
FORCE_SENSORS = "haptic_driver.force_sensors"
ANALOG_OUTPUTS = "haptic_driver.analog_outputs"
FINGER_TRACKERS = "haptic_driver.finger_trackers"
ELECTRODE_MONITORS = "haptic_driver.electrode_monitors"
CAMERAS = "haptic_driver.cameras"
LOAD_STAGES = "haptic_driver.load_stages"
SIMULATED = "simulated"
NO_WATCHDOG = "none"

Device = TypeVar("Device")

Volts = Annotated[float, Within(1e-3, 1000.0, "no electrode under a finger is driven with more")]
DirectVolts = Annotated[
    float, Within(0.0, 1000.0, "no electrode under a finger is driven with more")
]
LineVolts = Annotated[
    float, Within(-10.0, 10.0, "inputs and outputs of cards and generators end at 10 V")
]
Hertz = Annotated[float, Within(1e-6, 20e6, "no generator or card here is faster")]
SampleRate = Annotated[float, Within(1.0, 1e10, "no converter is faster")]
MonitorHertz = Annotated[
    float, Within(1.0, 1e9, "a slower monitor shows no carrier, and none is faster")
]
MonitorNoise = Annotated[float, Within(0.0, 10.0, "monitor lines end at 10 V")]
LoadNewtons = Annotated[
    float, Within(1e-3, 20.0, "no fingertip slides under more, and no sensor tells less")
]
ForceRange = Annotated[float, Within(0.1, 200.0, "no sensor under a fingertip measures more")]
Farads = Annotated[float, Within(0.0, 1e-6, "no electrode, panel and wiring have more")]
Metres = Annotated[float, Within(-2.0, 2.0, "no screen or stage is larger")]
Seconds = Annotated[float, Within(1e-6, 60.0, "nothing here waits for longer")]
Patience = Annotated[
    float, Within(1e-3, 10.0, "what may be wrong at the electrode is not waited for longer")
]
Axis = Annotated[str, Field(pattern=r"^[+-]?[xyz]$")]
Port = Annotated[int, Field(ge=1, le=65535)]


def _known_form(resource: str) -> str:
    if resource.startswith("card:"):
        return check_name(resource)
    if resource not in (SIMULATED, NO_WATCHDOG):
        from hw.transport.resource import (  # noqa: PLC0415 - imports what a real device needs
            make_transport,
        )

        make_transport(resource)
    return resource


Resource = Annotated[str, AfterValidator(_known_form)]
"""A name that `hw.transport.resource.make_transport` takes, or `hw.analog.cards.make_card`."""


class SignedFigures(Section):
    """A section whose figures somebody has to sign as measured, or the rig does not come on."""

    measured_by: str = Field(default="", description="who has measured this section's figures")
    measured_at: datetime.date | None = Field(
        default=None, description="since when, a date without quotes"
    )

    @property
    def verified(self) -> bool:
        return bool(self.measured_by.strip()) and self.measured_at is not None


class PartSection(Section):
    """A section whose `kind` says what is there. `files` are keys that name files beside the rig's
    file.
    """

    files: ClassVar[tuple[str, ...]] = ()
    needs_stage: ClassVar[bool] = False

    kind: str

    @property
    def channels(self) -> list[str]:
        """What it reads of the card of `[analog_inputs]`."""
        return []

    def given_for(self, record: type[Any]) -> dict[str, Any]:
        """What it says for the fields of the same name of a driver's settings, a dataclass."""
        return self.model_dump(include={field.name for field in fields(record)})

    def calibration(self) -> str:
        """Which calibration its figures come from, for whoever reads data later; raises
        DeviceError.
        """
        return ""

    def untold(self, *names: str) -> list[Setting]:
        """Figures that are computed with, of a device that does not say its own."""
        return [Setting(name, said, None) for name in names if (said := getattr(self, name, None))]

    def examine(self, at: Examination) -> Checks:
        """Only ask the device: set, switch, reset and move nothing, and close what was opened."""
        yield at.unverified(f"{self.kind}: how to ask it is not known here")


@dataclass(frozen=True)
class Wiring:
    """What a part may be connected to: the card's inputs, the stage, and the lines of an amplifier.

    `monitor_lines` says what the amplifier's monitors do, `monitor_channels` where on the card
    voltage and current are.
    """

    inputs: NiCards | None = None
    stage: Lts150 | None = None
    enable: DigitalOutput | None = None
    voltage_monitor: AnalogInput | None = None
    current_monitor: AnalogInput | None = None
    fault: DigitalInput | None = None
    monitor_lines: MonitorLines | None = None
    monitor_channels: Sequence[str] = ()


@dataclass(frozen=True)
class Part(Generic[Device]):
    """A device, not open, and how it is opened and closed.

    `zeroing` makes a force sensor's present load its zero, after `opening`. Where a rig is
    connected again a finger may press: the device is then asked to `keep_bias(before)` of the one
    before it.
    """

    device: Device
    opening: Sequence[Callable[[], object]] = ()
    closing: Sequence[Callable[[], object]] = ()
    zeroing: Sequence[Callable[[], object]] = ()


@dataclass(frozen=True)
class PartKind:
    """The section that a kind reads, and how its device is made; without `make` it is no device of
    a real rig.
    """

    section: type[PartSection]
    make: Callable[[Any, Wiring], Part[Any]] | None = None


def part_kind(group: str, name: str) -> PartKind:
    """The installed kind of that name; ValueError says what is installed."""
    kind = plugins.load(group, name, group.rpartition(".")[2].removesuffix("s").replace("_", " "))
    if not isinstance(kind, PartKind) or name not in get_args(
        kind.section.model_fields["kind"].annotation
    ):
        raise ValueError(
            f"{group}: {name!r} names {kind!r}, not a PartKind whose section has this kind"
        )
    return kind


class KindsOf(Kinds):
    """The sections of a group's kinds. One that fails at import, exits there or hangs breaks no rig
    but its own.
    """

    def __init__(self, group: str) -> None:
        self._group = group

    def __getitem__(self, name: str) -> type[PartSection]:
        """Raises ValueError as `part_kind`."""
        return part_kind(self._group, name).section

    def __iter__(self) -> Iterator[str]:
        """Names, whether or not they can be loaded."""
        return iter(sorted(plugins.installed(self._group)))

    def __len__(self) -> int:
        """How many are installed."""
        return len(plugins.installed(self._group))

    def __contains__(self, name: object) -> bool:
        """Whether one of that name is installed; it is not loaded for the answer."""
        return name in plugins.installed(self._group)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Read a section by its `kind`."""
        return core_schema.no_info_plain_validator_function(self._read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Describe the kinds that come with the driver; what else is installed describes itself."""
        own = [
            name for name, point in plugins.installed(self._group).items() if _is_own(point.value)
        ]
        sections = [handler(self[name].__pydantic_core_schema__) for name in sorted(own)]
        return {"oneOf": sections} if len(sections) > 1 else sections[0]

    def _read(self, content: object) -> PartSection:
        """Errors are placed as those of a union with a discriminator are: below the name of the
        kind.
        """
        name = content.get("kind") if isinstance(content, dict) else getattr(content, "kind", None)
        if name is None:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'kind'"})
        if name not in self:
            tags = {"discriminator": "'kind'", "tag": str(name), "expected_tags": ", ".join(self)}
            raise PydanticKnownError("union_tag_invalid", tags)
        section = self[cast(str, name)]
        try:
            return section.model_validate(content)
        except ValidationError as error:
            raise _below(str(name), error) from None


def _is_own(value: str) -> bool:
    return value.partition(".")[0] == __name__.partition(".")[0]


def _below(name: str, error: ValidationError) -> ValidationError:
    found: list[InitErrorDetails] = []
    for fault in error.errors():
        same: Any = PydanticCustomError(fault["type"], fault["msg"], fault.get("ctx"))
        found.append({"type": same, "loc": (name, *fault["loc"]), "input": fault["input"]})
    return ValidationError.from_exception_data(error.title, found)


def make_part(group: str, section: PartSection, wiring: Wiring) -> Part[Any] | None:
    """The device that a section describes, not open; None where there is none."""
    kind = part_kind(group, section.kind)
    return None if kind.make is None else kind.make(section, wiring)
