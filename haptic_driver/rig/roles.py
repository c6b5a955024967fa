"""What a rig may have: one field of `RigParts` a role, in the order in which devices are opened.

The keys of a rig's file, the assembly of its devices, addresses, contradictions, signed sections
and the doctor's list follow from this table. A kind is a class that makes and examines a device: a
`PartSection`. A package adds one by an entry point of the role's group that names the class. The
entry point's name is the value of `kind` in a rig's file. A kind is loaded where a rig names it,
and by no other rig.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from typing import Annotated, Any, cast, get_args

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError
from pydantic_core import (
    CoreSchema,
    InitErrorDetails,
    PydanticCustomError,
    PydanticKnownError,
    core_schema,
)

from haptic_driver.config import Kinds, Section
from haptic_driver.rig.part import DeviceSection, NoPart, PartSection
from haptic_driver.rig.parts.amplifiers import AmplifierConfig
from haptic_driver.rig.parts.analog_inputs import AnalogInputsSection
from haptic_driver.rig.parts.analog_outputs import NoAnalogOutput, SomeAnalogOutput
from haptic_driver.rig.parts.cameras import CameraSection
from haptic_driver.rig.parts.electrode_monitors import SomeElectrodeMonitor
from haptic_driver.rig.parts.event_lines import EventLineSection
from haptic_driver.rig.parts.finger_trackers import NoFingerTracker
from haptic_driver.rig.parts.force_sensors import UnsaidForceSensor
from haptic_driver.rig.parts.generators import GeneratorConfig
from haptic_driver.rig.parts.interlocks import NoInterlock
from haptic_driver.rig.parts.lines_in import LineInSection
from haptic_driver.rig.parts.load_stages import LoadStageSection
from haptic_driver.rig.parts.stages import StageSection
from hw import plugins
from hw.health import (
    EVENT_LINE,
    FORCE,
    GENERATOR,
    LINE,
    LINE_IN,
    READ,
    STAGE,
    TRACKER,
    UNASKED,
    Asking,
)


class Opens(enum.Enum):
    """When a device is opened; it is closed in the reverse order."""

    FIRST = "before the generator: it has to be there, or at zero, when a carrier comes"
    RIG = "together, by the rig: generator and amplifier"
    AFTER = "once the output is known to be off"
    APART = "by a thread of its own, which goes on trying"


class Role:
    """What a device is to a rig.

    `wired`: the field of `Wiring` that the device becomes for those after it. `unsaid`: what stands
    for a section that is not in the file, for the doctor. `asking`: how it is asked, by which its
    health is kept.
    """

    def __init__(
        self,
        name: str,
        opens: Opens,
        *,
        wired: str = "",
        unsaid: DeviceSection | None = None,
        asking: Asking = UNASKED,
    ) -> None:
        self.name, self.opens, self.wired, self.unsaid = name, opens, wired, unsaid
        self.asking = asking


class KindRole(Role, Kinds):
    """A role that has kinds: the sections of its group's entry points, of which a rig may have
    `many`.

    A kind that fails at import, exits there or hangs breaks no rig but its own. `usual`: the kind
    of a section that does not say it.
    """

    def __init__(
        self,
        group: str,
        opens: Opens,
        *,
        name: str = "",
        wired: str = "",
        unsaid: DeviceSection | None = None,
        usual: str | None = None,
        many: bool = False,
        asking: Asking = UNASKED,
    ) -> None:
        what = group.removesuffix("s").replace("lines_in", "line_in").replace("_", " ")
        super().__init__(name or what, opens, wired=wired, unsaid=unsaid, asking=asking)
        self.group, self.usual, self.many = f"haptic_driver.{group}", usual, many
        self._what = what

    def __getitem__(self, name: str) -> type[PartSection]:
        """The installed kind of that name; ValueError says what is installed."""
        kind = plugins.load(self.group, name, self._what)
        is_section = isinstance(kind, type) and issubclass(kind, PartSection)
        if not is_section or name not in get_args(kind.model_fields["kind"].annotation):
            raise ValueError(
                f"{self.group}: {name!r} names {kind!r}, not a PartSection of this kind"
            )
        return cast("type[PartSection]", kind)

    def __iter__(self) -> Iterator[str]:
        """Names, whether or not they can be loaded."""
        return iter(sorted(plugins.installed(self.group)))

    def __len__(self) -> int:
        """How many are installed."""
        return len(plugins.installed(self.group))

    def __contains__(self, name: object) -> bool:
        """Whether one of that name is installed; it is not loaded for the answer."""
        return isinstance(name, str) and name in plugins.installed(self.group)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Read a section by its `kind`."""
        schema: CoreSchema = core_schema.no_info_plain_validator_function(self._read)
        if self.many:
            return core_schema.list_schema(schema)
        return core_schema.nullable_schema(schema) if type(None) in get_args(source) else schema

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Describe the kinds that come with the driver; what else is installed describes itself."""
        own = [name for name, at in plugins.installed(self.group).items() if _is_own(at.value)]
        sections = [handler(self[name].__pydantic_core_schema__) for name in sorted(own)]
        either = {"oneOf": sections} if len(sections) > 1 else sections[0]
        return {"type": "array", "items": either} if self.many else either

    def _read(self, content: object) -> PartSection:
        """Errors are placed as those of a union with a discriminator are: below the name of the
        kind.
        """
        if self.usual is not None and isinstance(content, dict):
            content = {"kind": self.usual, **content}
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


FIRST, RIG, AFTER, APART = Opens


class RigParts(Section):
    """The devices that a rig's file may name."""

    analog_inputs: Annotated[
        AnalogInputsSection | None, KindRole("analog_inputs", FIRST, wired="inputs", usual="ni")
    ] = None
    interlock: Annotated[
        PartSection | None,
        KindRole("interlocks", FIRST, wired="enable", unsaid=NoInterlock(), asking=LINE),
    ] = None
    analog_output: Annotated[
        NoAnalogOutput | SomeAnalogOutput, KindRole("analog_outputs", FIRST, name="envelope")
    ] = NoAnalogOutput()
    waveform_generator: Annotated[
        GeneratorConfig, Role("waveform generator", RIG, asking=GENERATOR)
    ]
    amplifier: Annotated[
        AmplifierConfig, KindRole("amplifiers", RIG, wired="amplifier", usual="analog")
    ]
    force_sensor: Annotated[
        PartSection | None,
        KindRole("force_sensors", AFTER, unsaid=UnsaidForceSensor(), asking=FORCE),
    ] = None
    stage: Annotated[
        StageSection | None, KindRole("stages", AFTER, wired="stage", usual="lts150", asking=STAGE)
    ] = None
    finger_tracker: Annotated[PartSection, KindRole("finger_trackers", AFTER, asking=TRACKER)] = (
        NoFingerTracker()
    )
    electrode_monitors: Annotated[
        list[SomeElectrodeMonitor], KindRole("electrode_monitors", AFTER, many=True, asking=READ)
    ] = Field(default=[])
    camera: Annotated[NoPart | CameraSection, KindRole("cameras", AFTER)] = NoPart()
    load_stage: Annotated[
        NoPart | LoadStageSection, KindRole("load_stages", AFTER, asking=STAGE)
    ] = NoPart()
    event_line: Annotated[
        NoPart | EventLineSection, KindRole("event_lines", APART, asking=EVENT_LINE)
    ] = NoPart()
    line_in: Annotated[NoPart | LineInSection, KindRole("lines_in", APART, asking=LINE_IN)] = (
        NoPart()
    )

    def sections_of(self, key: str) -> list[DeviceSection]:
        """What the file says for a role."""
        said = getattr(self, key)
        return said if isinstance(said, list) else [] if said is None else [said]

    @property
    def devices(self) -> Iterator[tuple[str, DeviceSection]]:
        """Every section of the table, in its order, with its key; `key.0` where there are many."""
        for key, role in ROLES.items():
            many = isinstance(role, KindRole) and role.many
            for i, section in enumerate(self.sections_of(key)):
                yield f"{key}.{i}" if many else key, section


ROLES: dict[str, Role] = {
    key: role
    for key, field in RigParts.model_fields.items()
    for role in field.metadata
    if isinstance(role, Role)
}
"""The table by key."""
