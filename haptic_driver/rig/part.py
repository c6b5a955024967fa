"""What sections of a rig's file are made of: where a device is, how it is made, how it is examined.

`haptic_driver.rig.roles` has the table of what a rig may have.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Literal, Self, TypeVar

from pydantic import AfterValidator, Field, PrivateAttr

from haptic_driver.config import Section, Within
from haptic_driver.rig.check import Checks, Examination
from hw.analog.cards import check_name
from hw.setting import Setting

if TYPE_CHECKING:
    from hw.amplifier.analog import AnalogAmplifier
    from hw.analog.lines import AnalogInput, AnalogInputs, DigitalInput, DigitalOutput, Heartbeat
    from hw.monitor.lines import MonitorLines
    from hw.stage.lts150 import Lts150

SIMULATED = "simulated"
MONITORS = "voltage monitor", "current monitor", "fault line"
NONE = NO_WATCHDOG = "none"

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
Axis = Literal["x", "y", "z", "+x", "+y", "+z", "-x", "-y", "-z"]
Port = Annotated[int, Field(ge=1, le=65535)]


def _known_form(resource: str) -> str:
    if resource.startswith("card:"):
        return check_name(resource)
    if resource not in (SIMULATED, NO_WATCHDOG):
        # imports what a real device needs
        from hw.transport.resource import make_transport  # noqa: PLC0415

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


@dataclass(frozen=True)
class Wiring:
    """What a part may be connected to: the card's inputs, the stage, and the lines of an amplifier.

    `channels` are those of the card that the rig's file names. A monitor reports its peak over
    `monitor_window_s`. `monitor_lines` says what the amplifier's monitors do, `monitor_channels`
    where on the card voltage and current are. `amplifier` is the one on these lines.
    """

    channels: Sequence[str] = ()
    inputs: AnalogInputs | None = None
    monitor_window_s: float = 0.0
    stage: Lts150 | None = None
    enable: DigitalOutput | None = None
    voltage_monitor: AnalogInput | None = None
    current_monitor: AnalogInput | None = None
    fault: DigitalInput | None = None
    amplifier: AnalogAmplifier | None = None
    monitor_lines: MonitorLines | None = None
    monitor_channels: Sequence[str] = ()

    def peak(self, channel: str) -> AnalogInput | None:
        """A monitor of an alternating voltage by its peak, since its mean says nothing."""
        from hw.analog.ni_daq import NiAnalogInput  # noqa: PLC0415 - a real device's

        if self.inputs is None:
            return None
        return NiAnalogInput(self.inputs, channel, window_s=self.monitor_window_s, peak=True)


@dataclass(frozen=True)
class Part(Generic[Device]):
    """A device, not open, and how it is opened and closed.

    `zeroing` makes a force sensor's present load its zero, after `opening`. Where a rig is
    connected again a finger may press: the device is then asked to `keep_bias(before)` of the one
    before it. `heartbeats` have to be beaten while the output is on.
    """

    device: Device
    opening: Sequence[Callable[[], object]] = ()
    closing: Sequence[Callable[[], object]] = ()
    zeroing: Sequence[Callable[[], object]] = ()
    heartbeats: Sequence[Heartbeat] = ()


class DeviceSection(Section):
    """A section that describes a device: where it is, how it is made and how it is examined.

    `files` are keys that name files beside the rig's file. `told_by` is the key that says whether
    it is simulated. `served_as` is the endpoint of a simulated rig that answers as it does.
    """

    files: ClassVar[tuple[str, ...]] = ()
    told_by: ClassVar[str] = "resource"
    served_as: ClassVar[str] = ""
    needs_stage: ClassVar[bool] = False

    @property
    def addresses(self) -> list[str]:
        """Where it is, by the keys that usually say so; one program at a time may open it."""
        said = {key: getattr(self, key, None) for key in ("resource", "device", "line", "port")}
        if isinstance(host := getattr(self, "host", None), str):
            return [f"{host}:{said['port']}"]
        return [name for name in said.values() if isinstance(name, str) and name != SIMULATED]

    @property
    def is_simulated(self) -> bool | None:
        """None for what is on real and simulated rigs alike, such as nothing."""
        said = getattr(self, self.told_by)
        return None if said == NONE else bool(said == SIMULATED)

    def served_at(self, where: str) -> DeviceSection:
        """The section by which the simulated device is reached that is served there."""
        return self.model_copy(update={"resource": where})

    @property
    def channels(self) -> list[str]:
        """What it reads of the card of `[analog_inputs]`."""
        return []

    @property
    def monitors(self) -> dict[str, str]:
        """Which lines of the amplifier are read, by `MONITORS`, and where."""
        return {}

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
        raise NotImplementedError

    def wire(self, wiring: Wiring) -> Wiring:
        """What this section says of the wiring, to its own device and those after it."""
        return wiring

    def make(self, wiring: Wiring) -> Part[Any] | None:
        """The device, not open; None where there is none."""
        return None


class PartSection(DeviceSection):
    """A section whose `kind` says what is there: the class is what a kind's entry point names."""

    told_by = "kind"

    kind: str

    def examine(self, at: Examination) -> Checks:
        yield at.unverified(f"{self.kind}: how to ask it is not known here")


class ServedSection(PartSection):
    """A simulated device that is driven as a real one, once it is served: `where` is no key of a
    file.
    """

    _where: str = PrivateAttr("")

    @property
    def addresses(self) -> list[str]:
        return [self._where] if self._where else []

    def served_at(self, where: str) -> Self:
        same = self.model_copy()
        same._where = where
        return same


class NoPart(PartSection):
    """Nothing is there, said plainly."""

    kind: Literal["none"] = "none"

    def examine(self, at: Examination) -> Checks:
        """Nothing is missing."""
        return iter(())
