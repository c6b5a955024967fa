"""Kinds of force sensors."""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import (
    Axis,
    Farads,
    ForceRange,
    LoadNewtons,
    NoPart,
    Part,
    PartSection,
    Port,
    ServedSection,
    Wiring,
)
from hw.health import FORCE

if TYPE_CHECKING:
    from hw.force.net_ft import NetFt, NetFtSettings
    from hw.force.sensor import GaugeForceSensor, NoForceSensor


Counts = Annotated[float, Within(1e-3, 1e12, "no box counts a newton by fewer or more")]


class ForceSensorSection(PartSection):
    """What every force sensor has: how far it measures, of either sign. A reading beyond is not
    believed.

    The usual range is that of a sensor under a fingertip, which slides with less than 10 N. One
    that does not `measures_lateral` says NaN there.
    """

    measures_lateral: ClassVar[bool] = True

    normal_range_n: ForceRange = Field(
        default=50.0, description="what it can measure, of either sign; a reading beyond is a fault"
    )
    lateral_range_n: ForceRange = Field(default=50.0, description="likewise, along the slide")


class UnsaidForceSensor(NoPart):
    """The file says nothing of one."""

    def examine(self, at: Examination) -> Checks:
        yield at.failed("there is none in the rig's file", "add a section [force_sensor]")


class SimulatedForceSensorConfig(ForceSensorSection, ServedSection):
    """The simulated rig's own, a Net F/T box; its zero is right from the start, since a simulated
    finger may press.
    """

    served_as = "force_sensor"

    kind: Literal["simulated"] = "simulated"

    def make(self, wiring: Wiring) -> Part[NetFt]:
        from hw.force.net_ft import NetFt, NetFtSettings
        from hw.force.net_ft_server import SCALE
        from hw.force.sensor import ForceAxes

        host, port = self._where.split(":")
        box = NetFt(NetFtSettings(host, SCALE, ForceAxes("-z", "x"), port=int(port)))
        return Part(box, [box.open], [box.close])


class NoForceSensorConfig(ForceSensorSection):
    """None, said plainly: every finger is taken to press with `load_n`.

    Where the rig reads the electrode, and says by `stray_capacitance_f` what of its current flows
    without a finger, load and friction are estimated from it.
    """

    measures_lateral = False

    kind: Literal["none"]
    load_n: LoadNewtons = Field(
        default=0.5, description="what a finger is taken to press with where nothing measures it"
    )
    stray_capacitance_f: Farads | None = Field(
        default=None,
        description="of electrode and leads without a finger, from an open circuit; a simulated"
        " rig has its own",
    )

    def examine(self, at: Examination) -> Checks:
        if at.rig.friction_from_current:
            yield at.warning(
                "none; load and friction are estimated from the electrode's current",
                "docs/live.md says what that holds",
            )
            return
        hint = "docs/live.md says what that holds"
        if any(not monitor.drives for monitor in at.rig.electrode_monitors):
            hint = "give stray_capacitance_f, and they are estimated from the electrode's current"
        said = f"none; friction is the model's, at {self.load_n:g} N"
        yield at.warning(said, hint)

    def make(self, wiring: Wiring) -> Part[NoForceSensor]:
        """What stands for it."""
        from hw.force.sensor import NoForceSensor

        return Part(NoForceSensor(self.load_n))


class NiForceSensorConfig(ForceSensorSection):
    """An ATI transducer on the card of `[analog_inputs]`: six channels, gauges 0 to 5 in order.

    The calibration file's path counts from the rig's file.
    """

    files = ("calibration_file",)

    kind: Literal["ni"]
    gauges: Annotated[list[str], Field(min_length=6, max_length=6)] = Field(
        description="six analog inputs, gauges 0 to 5 in order"
    )
    calibration_file: str = Field(
        description="of the transducer; its path counts from the rig's file"
    )
    samples_per_reading: Annotated[int, Field(ge=1, le=100_000)] = Field(
        description="averaged into one reading"
    )
    samples_per_bias: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        description="averaged when the bias is taken"
    )
    normal_axis: Axis = Field(
        description="the signed axis whose force is > 0 when the finger presses"
    )
    lateral_axis: Axis = Field(description="and along the slide")

    @property
    def channels(self) -> list[str]:
        return self.gauges

    def calibration(self) -> str:
        """The transducer's, and what its file held."""
        from hw.force.ati_calibration import AtiCalibration

        file = Path(self.calibration_file)
        sensor = AtiCalibration.from_file(file)
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        return f"{sensor.serial}, calibrated {sensor.calibrated_on}, SHA-256 {content}"

    def examine(self, at: Examination) -> Checks:
        """Its calibration, and the gauges' voltages; no bias is taken."""
        from hw.force.ati_calibration import AtiCalibration

        assert at.rig.analog_inputs is not None  # or the file would have been refused
        sensor = AtiCalibration.from_file(Path(self.calibration_file))
        said = f"{sensor.serial} ({sensor.part_number}), calibrated: {sensor.calibrated_on}"
        calibration = at.called("force calibration")
        known = sensor.calibrated_on != "unknown"
        yield calibration.ok(said) if known else calibration.warning(said)
        with closing(at.rig.analog_inputs.inputs(self.gauges)) as inputs:
            inputs.open()
            gauges_v = inputs.latest_v(self.samples_per_bias)
            mean_v = ", ".join(f"{v:.3f}" for v in gauges_v.mean(axis=0))
            said = f"gauges at {mean_v} V"
            if sensor.saturated(gauges_v):
                yield at.failed(said, "unload it", inputs.held())
            else:
                yield at.ok(said, inputs.held())

    def make(self, wiring: Wiring) -> Part[GaugeForceSensor]:
        """Six columns of the card."""
        from hw.force.ati_calibration import AtiCalibration
        from hw.force.sensor import ForceAxes, GaugeForceSensor

        assert wiring.inputs is not None  # or the file would have been refused
        gauges = GaugeForceSensor(
            wiring.inputs.columns(self.gauges),
            AtiCalibration.from_file(Path(self.calibration_file)),
            ForceAxes(self.normal_axis, self.lateral_axis),
            samples_per_reading=self.samples_per_reading,
            samples_per_bias=self.samples_per_bias,
        )
        return Part(gauges, zeroing=[gauges.take_bias])


class NetFtForceSensorConfig(ForceSensorSection):
    """An ATI Net F/T box; see `hw.force.net_ft.NetFtSettings`."""

    served_as = "force_sensor"

    kind: Literal["net_ft"]
    host: str = Field(description="address of the box")
    port: Port = Field(default=49152, description="its UDP port")
    counts_per_n: Counts = Field(description="cfgcpf of the box's netftapi2.xml, for newtons")
    counts_per_n_m: Counts = Field(description="cfgcpt, for newton metres")
    timeout_s: Annotated[
        float, Within(1e-3, 5.0, "no record is sooner there; an older one tells another load")
    ] = Field(default=0.1, description="a reading is at most so old")
    ignored_status: Annotated[int, Field(ge=0, lt=1 << 32)] = Field(
        default=0, description="status bits that do not spoil a reading"
    )
    f_t_sequence_advances: bool = Field(
        default=True, description="false for a box whose F/T sequence stands still"
    )
    bias_tolerance_n: Annotated[
        float, Within(1e-4, 2.0, "more is a finger that presses, and no rest of a bias")
    ] = Field(default=0.2, description="what may remain on each axis after the bias was taken")
    normal_axis: Axis = Field(
        description="the signed axis whose force is > 0 when the finger presses"
    )
    lateral_axis: Axis = Field(description="and along the slide")

    def calibration(self) -> str:
        """The box's own scale."""
        return f"{self.counts_per_n:g} counts per N, {self.counts_per_n_m:g} per N m"

    def served_at(self, where: str) -> Self:
        """The simulated box there has a scale and axes of its own."""
        from hw.force.net_ft_server import SCALE

        host, port = where.split(":")
        own = {"normal_axis": "-z", "lateral_axis": "x", **SCALE._asdict()}
        return self.model_copy(update={"host": host, "port": int(port), **own})

    def settings(self) -> NetFtSettings:
        """The same, as the driver takes it."""
        from hw.force.net_ft import NetFtScale, NetFtSettings
        from hw.force.sensor import ForceAxes

        return NetFtSettings(
            scale=NetFtScale(self.counts_per_n, self.counts_per_n_m),
            axes=ForceAxes(self.normal_axis, self.lateral_axis),
            **self.given_for(NetFtSettings),
        )

    def examine(self, at: Examination) -> Checks:
        """One reading as it stands; no bias is taken."""
        from hw.force.net_ft import NetFt

        with closing(NetFt(self.settings())) as box:
            box.open()
            reading = box.read()
            said = (
                f"{box.resource}: {reading.normal_force_n:.3f} N down,"
                f" {reading.lateral_force_n:.3f} N along, status {box.status_raw:#010x}"
            )
            held = self.untold("counts_per_n", "counts_per_n_m")
            yield at.failed(said, held=held) if reading.saturated else at.ok(said, held)
            yield at.called("force readings").heard(box, FORCE)
            yield at.called("force scale").unverified(
                "counts and axes", "hang a known weight on it"
            )

    def make(self, wiring: Wiring) -> Part[NetFt]:
        """A client of the box."""
        from hw.force.net_ft import NetFt

        net_ft = NetFt(self.settings())
        return Part(net_ft, [net_ft.open], [net_ft.close], zeroing=[net_ft.take_bias])
