"""The safety file of a rig: what an ethics board asks about a device, from the rig's own file.

It states what the file says, what the model computes from it, and what tests of this program show.
It names standards and claims conformity with none; what nobody here could check is marked so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_driver.base.units import readable
from haptic_driver.lab.papers.currents import TouchCurrents, network_weight
from haptic_driver.lab.papers.document import Block, Document, Figure, Heading, Paragraph, Table
from haptic_driver.lab.papers.safety_facts import (
    NOT_CHECKED,
    SCOPE,
    VOLUNTEERS,
    Inspected,
    facts_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STUCK, SLIDING, LIMIT, FAULT = "#d1495b", "#1b6ca8", "#1a1a1a", "#e08e0b"


def safety_file(seen: Inspected) -> Document:
    """The whole paper."""
    facts = facts_of(seen)
    name, rig = facts["rig"], seen.config
    is_simulated = " (simulated)" if rig.simulated else ""
    return Document(
        title=f"Inspection report: rig '{name}'{is_simulated}",
        about=(
            f"{seen.today.isoformat()} · {facts['program']} · model '{seen.model.name}' · rig's"
            f" file SHA-256 {seen.sha256}"
        ),
        foot=f"rig '{name}', file {seen.sha256[:12]}, {seen.today.isoformat()}",
        blocks=[*_device(facts), *_electric(seen, facts), *_organisation(seen, facts)],
        facts=facts,
    )


def _device(facts: dict[str, Any]) -> Iterator[Block]:
    yield Paragraph(SCOPE)
    yield Heading("Device and configuration")
    rows = [(one["what"], one["configured"]) for one in facts["devices"]]
    yield Table(("part", "as the rig's file says"), rows, (1, 4))
    yield Heading("Limits, at the electrode")
    limits = facts["limits"]
    ohm = limits["series_resistance_ohm"]
    curve = ", ".join(f"{_hz(f)} {_ma(i)} mA" for f, i in limits["contact_current_a_rms"])
    low_hz, high_hz = limits["frequency_hz"]
    rows = [
        ("voltage", f"{limits['voltage_v']:g} V peak, carriers of {_hz(low_hz)} to {_hz(high_hz)}"),
        ("contact current, rms", f"{curve}; straight between these on logarithmic axes"),
        ("steady voltage", f"{limits['direct_voltage_v']:g} V"),
        ("series resistor", f"{ohm:g} ohm, measured" if ohm else "none that anybody measured"),
        (
            "rise, lease",
            f"{readable(limits['voltage_rise_v_per_s'], 'V/s')}; zero after"
            f" {limits['lease_s']:g} s without a refresh",
        ),
    ]
    yield Table(("limit", "as the rig's file says"), rows, (1, 4))


def _electric(seen: Inspected, facts: dict[str, Any]) -> Iterator[Block]:
    rig, stored = seen.config, facts["stored"]
    yield Heading("Current through a finger")
    yield Paragraph(VOLUNTEERS)
    yield Figure(
        lambda axes: _draw(axes, seen.currents),
        height_mm=58.0,
        caption=(
            "Left: current at the highest voltage that the limits allow at each carrier. 'Stuck' is"
            " a finger without an air gap (stuck or wet), under the worst load and at the worst"
            " time. Right: the frequency weight of the IEC 60990 network."
        ),
        panels=2,
    )
    rows = [
        (
            _hz(one["frequency_hz"]),
            f"{one['voltage_v']:.3g} ({one['held_by']})",
            _ma(one["sliding_a_rms"]),
            _ma(one["stuck_a_rms"]),
            _ma(one["limit_a_rms"]),
            "< 1 %" if one["share"] < 0.01 else f"{100.0 * one['share']:.0f} %",
            _ma(one["stuck_weighted_a_rms"]),
            _ma(one["fault_a_rms"]),
        )
        for one in facts["touch_currents"]
    ]
    header = (
        "carrier",
        "highest voltage, V peak (held by)",
        "sliding, mA",
        "stuck, mA",
        "limit, mA",
        "of limit",
        "stuck, IEC 60990, mA",
        "amplifier fault, mA",
    )
    yield Table(header, rows, (1.0, 2.6, 1.0, 1.0, 1.0, 0.9, 1.2, 1.2))
    amplifier_a = rig.amplifier.current_limit_a
    ohm = rig.limits.series_resistance_ohm
    most_v = stored["fault_voltage_v"]
    broken = f"the amplifier's current limit bounds the current ({_rms_ma(amplifier_a)} mA rms)"
    if ohm:
        broken += f", and the resistor ({_rms_ma(most_v / ohm)} mA rms)"
    yield Paragraph(
        "Currents are rms. 'IEC 60990' is the stuck current times the weight of the network, which"
        f" is meant for 15 Hz to 1 MHz ({NOT_CHECKED}); the network's own impedance in series would"
        f" lower it. 'Amplifier fault': it gives {most_v:g} V, whatever the driver limits, the"
        f" insulator is whole and the finger has no gap. If the insulator breaks, only {broken};"
        " no software does.",
        small=True,
    )
    yield Paragraph(
        f"These currents and limits hold for {facts['limits']['current_holds_for']}. Other fingers"
        " and hands, and a palm, feel the same voltage."
    )
    yield Paragraph(_stored_said(stored))


def _organisation(seen: Inspected, facts: dict[str, Any]) -> Iterator[Block]:
    yield Heading("Hazards")
    rows: list[tuple[str, ...]]
    rows = [(one["hazard"], one["source"], one["mitigation"], "") for one in facts["hazards"]]
    yield Table(("hazard", "source", "mitigation, and what remains", "signed"), rows, (2, 3, 7, 1))
    yield Heading("What each mechanism does when something fails")
    rows = [
        (
            one["mechanism"],
            one["configured"] or "NONE HERE",
            one["fails"] + " → " + one["then"] if one["configured"] else one["then"],
            "\n".join(one["tests"]) or "-",
        )
        for one in facts["failures"]
    ]
    header = ("mechanism", "on this rig", "what fails → what happens", "shown by, on simulation")
    yield Table(header, rows, (1.3, 1.5, 4.2, 5.4))
    yield Paragraph(
        "All tests run on simulated instruments and one machine, most of them before every change"
        " of the program, those of killed processes on demand.",
        small=True,
    )
    yield Heading("Measured by whom, and when")
    rows = [
        (one["section"], one["by"] or "NOBODY", one["on"] or "-", one["remark"])
        for one in facts["measured"]
    ]
    yield Table(("section of the file", "by", "on", "remark"), rows, (3, 3, 1.5, 3))
    missing = facts["refuses_to_come_on"]
    yield Paragraph(
        f"The rig refuses to come on until these are filled in: {'; '.join(missing)}."
        if missing
        else "Nothing that the rig requires before it comes on is missing."
    )
    yield Heading("Unverified")
    yield Paragraph("\n".join(f"– {one}" for one in facts["unverified"]))
    yield Heading("Standards named, none claimed")
    rows = [(one["standard"], one["about"], one["here"]) for one in facts["standards"]]
    yield Table(("standard", "about", "here"), rows, (2, 4, 5))
    yield Heading("Checklist, before a person touches the screen")
    rows = [("☐", item, "") for item in facts["checklist"]]
    yield Table(("", "tried or read on this rig", "value, date, initials"), rows, (0.3, 8, 3))
    yield Heading("Signatures")
    roles = ("built by", "inspected by", "safety officer", "principal investigator")
    rows = [(role, "", "", "") for role in roles]
    yield Table(("role", "name", "date", "signature"), rows, (2, 3, 2, 4), row_mm=8.0)


def _stored_said(stored: dict[str, float | None]) -> str:
    farad, limit_j = stored["panel_capacitance_f"], stored["energy_at_limit_j"]
    fault_j, charge_c = stored["energy_at_fault_j"], stored["charge_at_fault_c"]
    if farad is None or limit_j is None or fault_j is None or charge_c is None:
        return (
            "Energy stored: unknown, since the rig's file has no limits.panel_capacitance_f. The"
            " amplifier's own output stage and supply are not counted."
        )
    return (
        f"Energy stored in {1e9 * farad:.3g} nF of panel, wiring and amplifier output:"
        f" {1e6 * limit_j:.3g} µJ at the voltage limit; {1e6 * fault_j:.3g} µJ and"
        f" {1e6 * charge_c:.3g} µC if the amplifier gives its most. The amplifier's own supply is"
        f" not counted. Thresholds for a discharge are in the standards below: {NOT_CHECKED}."
    )


def _draw(axes: Sequence[Axes], found: TouchCurrents) -> None:
    current, weight = axes
    f = found.frequency_hz
    current.fill_between(f, found.limit_a, 1e3, color=LIMIT, alpha=0.07, lw=0)
    current.plot(f, found.limit_a, color=LIMIT, label="limit of the file")
    current.plot(f, found.fault_a, ":", color=FAULT, label="stuck, amplifier fault")
    current.plot(f, found.stuck_a, color=STUCK, label="stuck")
    current.plot(f, found.sliding_a, color=SLIDING, label="sliding")
    values = np.concatenate([found.limit_a, found.sliding_a, found.stuck_a, found.fault_a])
    shown = values[np.isfinite(values) & (values > 0.0)]
    current.set(
        xscale="log",
        yscale="log",
        xlim=f[[0, -1]],
        ylim=(0.5 * shown.min(), 3.0 * shown.max()),
        xlabel="carrier, Hz",
        ylabel="current, A rms",
    )
    current.legend(frameon=False, fontsize=6.5)
    hz = np.geomspace(15.0, 1e6, 121)
    weight.plot(hz, network_weight(hz), color=LIMIT)
    weight.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="weight")
    for one in axes:
        one.grid(alpha=0.25)


def _rms_ma(peak_a: float) -> str:
    return _ma(peak_a / sqrt(2.0))


def _ma(ampere: float | None) -> str:
    return "-" if ampere is None else f"{1e3 * ampere:.3g}"


def _hz(frequency_hz: float) -> str:
    for size, unit in ((1e6, "MHz"), (1e3, "kHz")):
        if frequency_hz >= size:
            return f"{frequency_hz / size:g} {unit}"
    return f"{frequency_hz:g} Hz"
