"""What a rig's safety file says, as facts: from the rig's file, and computed from it."""

from __future__ import annotations

import datetime
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from math import isfinite
from typing import Any

import numpy as np

from haptic_driver.base.units import readable
from haptic_driver.config import find_config
from haptic_driver.lab.papers.currents import (
    TouchCurrents,
    fault_voltage_v,
    listed_hz,
    touch_currents,
)
from haptic_driver.lab.papers.mechanisms import MECHANISMS
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.check import OLD_AFTER
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.part import MONITORS
from haptic_driver.rig.parts.interlocks import InterlockBox
from model.description import ModelDescription
from model.support.reading import read_bytes

NOT_CHECKED = "not checked"

SCOPE = (
    "This report is written by a program from the file that configures the rig. It claims no"
    " conformity with any standard and replaces no inspection. Currents are computed by a model of"
    " the touch; nothing was measured for this report. The texts of the standards were not at hand:"
    f" what could not be compared with them is marked '{NOT_CHECKED}'."
)
VOLUNTEERS = (
    "The limit curve is a reference level for contact current, made for the general public."
    " Guidelines of this kind do not cover volunteers in research: whether this current is"
    " acceptable in a study is for the ethics board and the laboratory's safety officer to decide."
)
STANDARDS = (
    (
        "ICNIRP 2010, Health Phys. 99:818",
        "reference levels, contact current, general public: 0.5 mA to 2.5 kHz, 0.2 mA per kHz to"
        " 100 kHz, 20 mA to 10 MHz",
        f"the usual limit curve of a rig's file; numbers {NOT_CHECKED} against the text",
    ),
    (
        "IEC 60990",
        "networks to measure touch current; the one for perception and reaction weighs frequency",
        "1500 ohm beside 0.22 µF, 500 ohm, 10 kohm, 0.022 µF as public manuals print them;"
        f" {NOT_CHECKED}. Names no limits",
    ),
    (
        "IEC 60479-1, -2",
        "effects of current on people, by path, duration, frequency and charge",
        f"not used: thresholds {NOT_CHECKED}",
    ),
    (
        "IEC 61010-1, IEC 61140",
        "safety of laboratory equipment; protection against electric shock, stored charge",
        f"not used: limits {NOT_CHECKED}",
    ),
    ("IEC 60601-1", "medical electrical equipment", "not used: this is no medical device"),
)
EVERY_RIG_UNVERIFIED = (
    "touch current at the electrode, with a network of IEC 60990 and a person's finger",
    "the insulator: thickness, permittivity and strength are the model's, not this screen's",
    "behaviour of the real instruments when they fail: tests ran on simulated ones",
    "direct current through the insulator: no model here bounds it",
)


@dataclass(frozen=True)
class Inspected:
    """A rig's file, what is computed of it, and when."""

    config: RigConfig
    text: str
    sha256: str
    model: ModelDescription
    currents: TouchCurrents
    today: datetime.date


def inspect(rig: str, model: str, today: datetime.date) -> Inspected:
    """Both by name or path; a simulated rig's finger is the model's. Raises BadInputError."""
    config, description = load_rig(rig), load_model(model)
    content = read_bytes(find_config(rig, "rigs"))
    text, digest = content.decode("utf-8-sig"), hashlib.sha256(content).hexdigest()
    currents = touch_currents(config, description)
    return Inspected(config, text, digest, description, currents, today)


def facts_of(seen: Inspected) -> dict[str, Any]:
    rig, limits = seen.config, seen.config.limits
    holds_for = rig.operating_limits().holds_for(seen.model.values.contact_area_m2)
    return {
        "rig": rig.name,
        "file_sha256": seen.sha256,
        "simulated": rig.simulated,
        "date": seen.today.isoformat(),
        "program": f"haptic-driver {version('haptic-driver')}",
        "model": {"name": seen.model.name, "hash": seen.model.content_hash},
        "conformity_claimed": False,
        "statements": [SCOPE, VOLUNTEERS],
        "devices": [{"what": what, "configured": how} for what, how in _devices(rig)],
        "limits": {
            "voltage_v": limits.voltage_v,
            "frequency_hz": list(limits.frequency_hz),
            "direct_voltage_v": limits.direct_voltage_v,
            "contact_current_a_rms": [list(point) for point in limits.contact_current_a_rms],
            "series_resistance_ohm": limits.series_resistance_ohm,
            "touching_area_m2": limits.touching_area_m2,
            "current_holds_for": holds_for,
            "voltage_rise_v_per_s": rig.output.voltage_rise_v_per_s,
            "lease_s": rig.safety.lease_s,
        },
        "touch_currents": _current_facts(seen.currents),
        "stored": _stored(rig),
        "hazards": [
            {"hazard": hazard, "source": source, "mitigation": mitigation}
            for hazard, source, mitigation in _hazards(rig, holds_for)
        ],
        "failures": [
            mechanism.facts(rig)
            for mechanism in MECHANISMS
            if mechanism.here(rig) or mechanism.without
        ],
        "measured": _measured(rig, seen.today),
        "refuses_to_come_on": rig.unverified,
        "unverified": [*_marked(seen.text), *EVERY_RIG_UNVERIFIED],
        "standards": [
            {"standard": standard, "about": about, "here": here}
            for standard, about, here in STANDARDS
        ],
        "checklist": list(_checklist(rig)),
    }


def _devices(rig: RigConfig) -> Iterator[tuple[str, str]]:
    generator, amplifier = rig.waveform_generator, rig.amplifier
    yield "waveform generator", f"{generator.model} at {generator.resource}"
    yield (
        "amplifier",
        f"gain {amplifier.gain_v_per_v:g} V/V, at most {amplifier.voltage_limit_v:g} V and"
        f" {readable(amplifier.current_limit_a, 'A')} peak,"
        f" {readable(amplifier.slew_limit_v_per_s, 'V/s')}",
    )
    lines = [f"{name} {rig.monitors.get(name, 'none')}" for name in MONITORS]
    yield "amplifier's lines", ", ".join(lines)
    watchdog = rig.watchdog
    yield (
        "watchdog",
        "none" if watchdog is None else f"{watchdog.generator}, period {watchdog.period_s:g} s",
    )
    interlock = rig.interlock
    where = getattr(interlock, "resource", None) or getattr(interlock, "line", "")
    yield "interlock", "none" if interlock is None else f"{interlock.kind} {where}".strip()
    parts = {
        "force sensor": rig.force_sensor,
        "finger tracker": rig.finger_tracker,
        "envelope": rig.analog_output,
        "load stage": rig.load_stage,
        "camera": rig.camera,
    }
    said = [f"{name} {'none' if one is None else one.kind}" for name, one in parts.items()]
    stage = "none" if rig.stage is None else f"up to {1e3 * rig.stage.velocity_limit_m_s:g} mm/s"
    yield "other parts", f"{', '.join(said)}, stage {stage}"


def _current_facts(found: TouchCurrents) -> list[dict[str, Any]]:
    low_hz, high_hz = float(found.frequency_hz[0]), float(found.frequency_hz[-1])
    rows = []
    for frequency_hz in listed_hz(low_hz, high_hz).tolist():
        i = int(np.argmin(np.abs(found.frequency_hz - frequency_hz)))
        rows.append(
            {
                "frequency_hz": frequency_hz,
                "voltage_v": float(found.voltage_v[i]),
                "held_by": found.held_by[i],
                "sliding_a_rms": _known(found.sliding_a[i]),
                "stuck_a_rms": _known(found.stuck_a[i]),
                "limit_a_rms": float(found.limit_a[i]),
                "share": float(found.share[i]),
                "stuck_weighted_a_rms": _known(found.weighted_a[i]),
                "fault_a_rms": _known(found.fault_a[i]),
            }
        )
    return rows


def _stored(rig: RigConfig) -> dict[str, float | None]:
    """Energy and charge of panel, wiring and amplifier output; None where its capacitance is not
    given.
    """
    farad, most_v = rig.limits.panel_capacitance_f, fault_voltage_v(rig)
    known = farad > 0.0

    def joule(voltage_v: float) -> float | None:
        return 0.5 * farad * voltage_v**2 if known else None

    return {
        "panel_capacitance_f": farad if known else None,
        "fault_voltage_v": most_v,
        "energy_at_limit_j": joule(rig.limits.voltage_v),
        "energy_at_fault_j": joule(most_v),
        "charge_at_fault_c": farad * most_v if known else None,
    }


def _hazards(rig: RigConfig, holds_for: str) -> Iterator[tuple[str, str, str]]:
    ohm = rig.limits.series_resistance_ohm
    yield (
        "current through the finger",
        "carrier under a finger that slides, sticks or is wet",
        "every set point is judged by the finger without a gap, in two places, and refused beyond"
        " the limit curve; remains: the model's insulator may not be this screen's",
    )
    yield (
        "current through more than one finger",
        "a second finger, another person's hand, a palm: all feel the same voltage",
        f"the limits hold for {holds_for}; more that the touch screen tells switches off; remains:"
        " what it does not tell, and a palm where the file names less than 9000 mm²",
    )
    yield (
        "current through a broken insulator",
        "crack, scratch, breakdown",
        (f"a resistor of {ohm:g} ohm bounds it" if ohm else "NO RESISTOR is named in the file")
        + f"; the amplifier's own limit of {1e3 * rig.amplifier.current_limit_a:g} mA peak; look at"
        " the screen before each session",
    )
    yield (
        "output stays on",
        "program, computer, link or cable fails",
        "lease, watchdog, interlock, E-stop (see the next table); remains without an interlock:"
        " driver and watchdog stopped together, a cable that is cut",
    )
    yield (
        "voltage is not what was set",
        "wrong gain, wrong load setting, another program",
        "read-back, monitor and claims (see the next table); remains: a wrong figure in the rig's"
        " file is believed within its range",
    )
    yield (
        "discharge",
        "charge on panel, wiring and amplifier output",
        "output rises slowly, and goes to zero when the finger leaves; remains: energy as above",
    )
    if rig.stage is not None or rig.load_stage.kind != "none":
        yield (
            "pinching, pressing",
            "stages that move",
            "speed and load limits of the file; a stage that loses its program goes on to the end"
            " of its move: keep an emergency stop in reach",
        )
    yield (
        "implants, broken skin, pregnancy",
        "current and field near the body",
        "not covered by any limit here: exclude by question before the session",
    )


def _measured(rig: RigConfig, today: datetime.date) -> list[dict[str, str | None]]:
    rows = []
    for name, section in rig.signed_sections.items():
        on = section.measured_at
        remark = ""
        if not section.verified:
            remark = "not verified: the rig refuses to come on"
        elif on is not None and on > today:
            remark = "this date is still to come"
        elif on is not None and today - on > OLD_AFTER:
            remark = "longer than a year ago: measure again"
        date = None if on is None else on.isoformat()
        rows.append({"section": name, "by": section.measured_by, "on": date, "remark": remark})
    return rows


def _marked(text: str) -> list[str]:
    """Keys and sections whose line in the file says "unverified"."""
    section, found = "", []
    for line in text.splitlines():
        if heading := re.match(r"\[+([\w.]+)\]+", line):
            section = f"{heading[1]}."
            if "unverified" in line:
                found.append(f"[{heading[1]}]")
        key = re.match(r"(\w+)\s*=.*#.*\bunverified\b", line)
        if key:
            found.append(f"{section}{key[1]}")
    return found


def _checklist(rig: RigConfig) -> Iterator[str]:
    yield "every figure of the rig's file measured on this rig, written down with name and date"
    yield (
        "touch current measured at the electrode through a network of IEC 60990, at the carriers of"
        " the table, with the finger's place short-circuited by foil on the insulator"
    )
    yield (
        "the screen has no crack, scratch or loose edge, and its insulator has withstood"
        f" {fault_voltage_v(rig):g} V"
    )
    if rig.limits.series_resistance_ohm == 0.0:
        yield "a resistor put in series with the electrode, measured, and written into the file"
    yield "emergency stop pressed while armed: the voltage at the electrode is gone within"
    yield "driver killed while armed (kill -9): the voltage is gone within"
    if isinstance(rig.interlock, InterlockBox):
        yield "interlock's cable pulled while armed: its contact opens, the voltage is gone within"
    else:
        yield "nobody touches the screen alone: there is no heartbeat interlock"
    yield "haptic doctor reports no failure; its answer is kept with this report"
    yield (
        "participants are told what they touch, may stop at any time, and are asked about implants"
    )
    yield "a person who knows the emergency stop is present in every session"
    yield f"to be inspected again on (at the latest {OLD_AFTER.days} days from now)"


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None
