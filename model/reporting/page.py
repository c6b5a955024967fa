"""A report as one self-contained page for people: no scripts, nothing to load from elsewhere."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from math import log
from pathlib import Path
from string import Template
from typing import Any

from model.diagnosis.priors import NONE, UNKNOWN, words
from model.diagnosis.readings import VOLTAGES_MEANT
from model.diagnosis.where import ALARM, DRAWS
from model.diagnosis.witness import BY_COLUMN
from model.effects.drive_gain_error import DriveGainError
from model.effects.learned import LEARNED

PAGE = Template(Path(__file__).with_suffix(".html").read_text(encoding="utf-8"))
LEADING = 5  # hypotheses that are listed one by one
PIXELS = 1.3  # of the page to one point of a picture: its letters are as large as the page's
COLOURS = {
    "no_discrepancy": "#5b8c5a",
    "effect_found": "#1b6ca8",
    "ambiguous": "#e08e0b",
    "unexplained": "#d1495b",
    "not_testable": "#9aa0a6",
}
NEAR = 0.1  # to such a factor: so much is a usual amplifier off
AXIS_WORDS = {
    "frequency_hz": ("frequency", "Hz"),
    "voltage_v": ("voltage", "V"),
    "normal_force_n": ("normal force", "N"),
    "speed_m_s": ("speed", "m/s"),
    "time_s": ("time", "s"),
}


def sentence(content: Mapping[str, Any]) -> str:
    """The verdict in plain words."""
    names = [words(e["name"]) for e in content["effects"]]
    probability = _probability(content["probability"])
    if content["verdict"] == "no_discrepancy":
        return f"These data show nothing missing from the model (probability {probability})."
    if content["verdict"] == "effect_found":
        verb = "is" if len(names) == 1 else "are"
        text = f"{_upper(_and(names))} {verb} missing from the model: probability {probability}"
        closes = _closes(content)
        it = "it" if verb == "is" else "them"
        return f"{text}; adding {it} {closes}; {_left(content)}." if closes else f"{text}."
    if content["verdict"] == "ambiguous":
        members = [words(n) for n in content["checks"]]
        if len(members) > 1:
            return (
                "One of these is missing from the model, and these data cannot tell which:"
                f" {_and(members, 'or')}."
            )
        return (
            f"Something may be missing from the model; {_and(names)} leads with probability"
            f" {probability}."
        )
    if content["verdict"] == "unexplained":
        return _unexplained(content)
    return f"These data cannot test the model: {'; '.join(content['reasons'])}."


def _unexplained(content: Mapping[str, Any]) -> str:
    if content["looks_like"]:
        likely = " ".join(f"{_upper(said)}." for said in content["looks_like"])
        return f"The data disagree with the model. {likely}"
    text = "The data disagree with the model, and no effect that this program knows explains how"
    closes = _closes(content) if content["effects"] else ""
    return f"{text}; a learned term {closes}; {_left(content)}." if closes else f"{text}."


def question(content: Mapping[str, Any]) -> str:
    """What to ask about the file before an effect is believed; empty where nothing is."""
    gains = [
        e["parameters"]["gain"]["value"]
        for e in content["effects"]
        if e["name"] == DriveGainError.name
    ]
    for gain in gains:
        factor = min(VOLTAGES_MEANT, key=lambda factor: abs(log(gain / factor)))
        if abs(log(gain / factor)) < NEAR:
            return (
                f"Are the voltages of these data {VOLTAGES_MEANT[factor]}? They are read as peak"
                f" amplitudes, and a gain of {gain:.3g} was found: check the file before the drive."
            )
    return ""


def _closes(content: Mapping[str, Any]) -> str:
    """What adding it does to the error on data left out of the fit; empty where that is unknown."""
    fit = content["fit"]
    if fit["gap_closed"] is None:
        return ""
    return gap_said(fit["gap_closed"], fit["gap_closed_interval"])


def _left(content: Mapping[str, Any]) -> str:
    """What disagrees with the model that has it, and where."""
    if not content["left"]:
        if content["adequate"]:
            return "nothing is left beyond chance"
        return "something of another shape is left, in no one region"
    return f"what is left is most at {' and '.join(_range(content['left'][0]))}"


def gap_said(share: float, interval: Sequence[float | None]) -> str:
    """What share of the gap closes on data left out of the fit, with its interval, in words."""
    percent = 100.0 * share
    low, high = interval
    within = "" if low is None or high is None else f" ({_share(low)} to {_share(high)})"
    if percent <= 0.0:
        return f"closes nothing of the gap on data left out of the fit{within}"
    much = "all" if percent >= 99.5 else f"{percent:.0f} %"
    return f"closes {much} of the gap on data left out of the fit{within}"


def _meaning(content: Mapping[str, Any]) -> str:
    """What follows from the verdict, in one or two sentences."""
    steps = content["next_experiments"]
    if content["verdict"] == "ambiguous":
        if steps and steps[0]["kind"] == "setting":
            return "The settings under “What to measure next” tell the leading two apart."
        return (
            "No setting of frequency, voltage, load or speed tells them apart; the physical checks"
            " below do."
        )
    if content["verdict"] == "unexplained":
        return (
            "Nothing is missing if that is so, and no effect gets a name before it is sure."
            if content["looks_like"]
            else "Something happens that the catalogue does not contain, or not in this form. No"
            " name is given because none is earned; the regions below show where to look."
        )
    if content["verdict"] == "not_testable":
        advice = (
            "Give cof_std, or measure every setting at least twice. "
            if content["data"]["noise_source"] is None
            else ""
        )
        return (
            advice
            + "Nothing was fitted; the probabilities in report.json are those held before any data."
        )
    if content["verdict"] == "effect_found" and not content["adequate"]:
        return (
            "The effect is needed, but something of another shape remains beside it: see the"
            " residuals."
        )
    return ""


def write_html(content: Mapping[str, Any], drawn: Mapping[str, bytes], path: Path) -> None:
    """One page that needs nothing beside it: no scripts, no downloads."""
    sections = [
        ("Data and warnings", _audit(content)),
        ("Where data and model disagree", _where(content, drawn)),
        ("Which effect", _which(content, drawn)),
        ("Learned term", _list(content["learned"]["words"]) if content["learned"] else ""),
        ("Parameters before and after", _before_after(content)),
        ("Proof on data left out of the fit", _proof(content, drawn)),
        ("What to measure next", _next(content)),
        ("What these data could not show", _out_of_sight(content)),
        (
            "Physical checks at the rig",
            _list([f"{_upper(words(n))}: {c}" for n, c in content["checks"].items()]),
        ),
        ("Where this comes from", _provenance(content)),
    ]
    page = PAGE.substitute(
        title=escape(f"Diagnosis: {content['verdict'].replace('_', ' ')}"),
        colour=COLOURS[content["verdict"]],
        source=escape(content["data"].get("file") or "measured friction"),
        sentence=escape(sentence(content)),
        meaning=escape(f"{question(content)} {_meaning(content)}".strip()),
        body="\n".join(f"<h2>{escape(title)}</h2>\n{body}" for title, body in sections if body),
    )
    path.write_bytes(page.encode(errors="backslashreplace"))  # the name of a file may be no UTF-8


def _audit(content: Mapping[str, Any]) -> str:
    data = content["data"]
    sessions = f"{data['sessions']} session{'' if data['sessions'] == 1 else 's'}"
    text = f"{data['rows']} rows, {data['rows_with_voltage']} of them with voltage, in {sessions}. "
    if data["noise_source"] is None:
        text += "The noise is unknown."
    else:
        repeats = data["replicate_degrees_of_freedom"]
        checked = f", checked by {repeats} repeats" if repeats else ""
        each = [
            f"{BY_COLUMN[name].words}"
            f" {f'{std:.2g} rad' if BY_COLUMN[name].is_phase else f'{100.0 * std:.2g} %'}"
            for name, std in data["noise_std"].items()
        ]
        text += f"Noise of one row: {_and(each)} (from {data['noise_source']}{checked})."
    read_as = "".join(f'<p class="quiet">{escape(said)}</p>' for said in data["read_as"])
    warnings = "".join(f'<p class="warn">Warning: {escape(w)}</p>' for w in content["warnings"])
    untested = [f"{words(e['name'])} ({e['why']})" for e in content["not_tested"]]
    missing = f'<p class="quiet">Not tested: {escape(", ".join(untested))}.</p>' if untested else ""
    return f"<p>{escape(text)}</p>{read_as}{warnings}{missing}"


def _where(content: Mapping[str, Any], drawn: Mapping[str, bytes]) -> str:
    if not content["where"]:
        return ""
    certain = [r for r in content["where"] if r["p_value"] < ALARM]
    lead = (
        "The disagreement lies somewhere in these regions; their edges are not exact."
        if certain
        else "No region of the inputs disagrees beyond chance."
    )
    rows = [
        [
            " and ".join(_range(r)),
            str(r["rows"]),
            (
                f"{r['mean_error_rad']:+.3f} rad"
                if r["mean_error_rad"] is not None
                else f"{100.0 * r['mean_relative_error']:+.1f} %"
            ),
            f"{BY_COLUMN[r['witness']].words}: {'more' if r['sign'] > 0 else 'less'}",
            f"{r['p_value']:.2g}"
            + (" (least possible)" if r["p_value"] <= 1.0 / (DRAWS + 1.0) + 1e-9 else ""),
        ]
        for r in certain
    ]
    head = ["region", "rows", "measured − predicted", "measured is", "probability by chance"]
    pictured = _image(
        drawn, "spectrum", "The electrode's current over frequency, measured and predicted"
    )
    pictured += _image(
        drawn, "residual_map", "Residuals over frequency and voltage, before and after"
    )
    pictured += _image(drawn, "residual_over_time", "Residuals over time, before and after")
    return f"<p>{escape(lead)}</p>{_rows(head, rows)}<p>{escape(_changed(content))}</p>{pictured}"


def _changed(content: Mapping[str, Any]) -> str:
    """How much of the data is changed by what is missing, and where most of that lies."""
    changed = content["changed"]
    if not changed["rows"]:
        return "What is missing changes no row of friction by more than its noise."
    if changed["rows"] == changed["of"]:
        return "What is missing changes friction by more than its noise in every row."
    first = " and ".join(_from_to(axis, *limits) for axis, limits in changed["where"][0].items())
    return (
        f"What is missing changes friction by more than its noise in {changed['rows']} of"
        f" {changed['of']} rows; the largest range of these is {first}."
    )


def _range(region: Mapping[str, Any]) -> list[str]:
    def listed(value: Any) -> list[Any]:
        return list(value) if isinstance(value, list) else [value]

    triples = zip(
        listed(region["axis"]), listed(region["low"]), listed(region["high"]), strict=True
    )
    return [_from_to(*triple) for triple in triples]


def _from_to(axis: str, low: float, high: float) -> str:
    name, unit = AXIS_WORDS.get(axis, (axis, ""))
    return f"{name} {_plain(low)}{'' if low == high else f' to {_plain(high)}'} {unit}".rstrip()


def _which(content: Mapping[str, Any], drawn: Mapping[str, bytes]) -> str:
    bars = _image(drawn, "probabilities", "Probability of every leading candidate")
    prints = "".join(
        _image(drawn, name, "Fingerprint of the leading candidates beside the data")
        for name in drawn
        if name.startswith("fingerprint")
    )
    rows = [
        [
            words(c["name"]),
            _probability(c["probability"]),
            _signed(c["log_evidence_gain"]),
            f"{c['chi2_per_point']:.2f}",
            _values({name: p for name, p in c["parameters"].items() if name != LEARNED}),
        ]
        for c in content["candidates"]
    ]
    head = ["model", "probability", "log evidence gained", "squared error per point", "fitted"]
    reasons = "; ".join(content["reasons"])
    whole = [[_upper(said), _probability(p)] for said, p in leading_hypotheses(content)]
    said = f"<p>{escape(_upper(reasons))}.</p>{_rows(['hypothesis', 'probability'], whole)}"
    return f"{said}{bars}{prints}{_rows(head, rows)}" if rows else ""


def leading_hypotheses(content: Mapping[str, Any]) -> list[tuple[str, float]]:
    """The most probable whole hypotheses in words, and all others together, summing to one."""
    found = [(whole_hypothesis(h["names"]), h["probability"]) for h in content["hypotheses"]]
    others = sum(p for _, p in found[LEADING:])
    return [*found[:LEADING], *([("all others together", others)] if others else [])]


def whole_hypothesis(names: Sequence[str]) -> str:
    """All that a hypothesis holds, as people say it."""
    effects = [words(name) for name in names if name not in (NONE, UNKNOWN)]
    if not effects:
        return words(names[0])
    return _and([*effects, "something unknown"] if UNKNOWN in names else effects)


def _values(effects: Mapping[str, Any]) -> str:
    fitted = [(name, p) for values in effects.values() for name, p in values.items()]
    return ", ".join(f"{name} {_measured(p)} {_unit(p)}".rstrip() for name, p in fitted)


def _measured(p: Mapping[str, Any]) -> str:
    return _plain(p["value"], 3) + ("" if p["std"] is None else f" ± {_plain(p['std'], 1)}")


def _unit(p: Mapping[str, Any]) -> str:
    return "" if p["unit"] == "1" else str(p["unit"])


def _plain(value: float, digits: int = 4) -> str:
    """A number without an exponent where people write none, thousands apart."""
    if value != 0.0 and not 1e-3 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:,.0f}".replace(",", " ") if abs(rounded) >= 1000.0 else f"{rounded:g}"


def _before_after(content: Mapping[str, Any]) -> str:
    rows = []
    for p in content["parameters"]:
        fits = [
            cell
            for fit in (p["before"], p["after"])
            for cell in (_measured(fit), _signed(fit["drift"]))
        ]
        rows.append([p["name"], _plain(p["model"]), *fits, _unit(p)])
    for e in content["effects"]:
        # values at nodes: in model.toml
        for name, p in e["parameters"].items() if e["name"] != LEARNED else ():
            rows.append([f"{words(e['name'])}: {name}", "off", "", "", _measured(p), "", _unit(p)])
    head = [
        "parameter",
        "in the model",
        "fitted, as given",
        "drift",
        "fitted, with the effect",
        "drift",
        "unit",
    ]
    note = (
        '<p class="quiet">Drift: in standard deviations of what is expected between fingers.</p>'
        if rows
        else ""
    )
    return _rows(head, rows) + note


def _signed(value: float) -> str:
    return f"{round(value, 1) + 0.0:+.1f}"


def _proof(content: Mapping[str, Any], drawn: Mapping[str, bytes]) -> str:
    held = content["held_out"]
    if held is None:
        return ""
    fit = content["fit"]["held_out_chi2_per_point"]
    text = (
        f"Squared error per point, in units of the noise: {_figure(fit['before'])} with the model"
        " as given"
    )
    if content["effects"]:
        text += (
            f", {_figure(fit['after'])} with the effect chosen anew without the {held['by']} in"
            " question"
        )
    text += " (noise alone: 1). "
    low, high = content["fit"]["gap_closed_interval"]
    if content["effects"] and content["fit"]["gap_closed"] is not None:
        text += f"Gap closed: {_share(content['fit']['gap_closed'])}"
        text += (
            f" (95 % interval {_share(low)} to {_share(high)})"
            if low is not None and high is not None
            else ""
        )
        text += f"; the same choice in {_share(held['chosen_again'])} of the {held['by']}s. "
    alternative = held["best_rival"]
    if alternative is not None and content["effects"] and alternative.get("gap_closed") is not None:
        name, closes = words(alternative["name"]), _share(alternative["gap_closed"])
        text += f"The best alternative, {name}, closes {closes}."
    return f"<p>{escape(text)}</p>" + _image(drawn, "held_out", "Held-out error before and after")


def _next(content: Mapping[str, Any]) -> str:
    steps = content["next_experiments"]
    if not steps:
        return ""
    settings = [s for s in steps if s["kind"] == "setting"]
    if not settings:
        best, enough = _figure(steps[0]["lambda_after"]), steps[0]["lambda_enough"]
        none = (
            f"No setting within reach {steps[0]['purpose']} (separation at best {best},"
            f" {enough:.0f} needed)."
        )
        return f"<p>{escape(none)} See the physical checks below.</p>"
    axes = [a for a in AXIS_WORDS if a in settings[0]]
    head = ["", *(", ".join(AXIS_WORDS[a]) for a in axes), "readings"]
    rows = [
        [str(i), *("any" if s[a] is None else _plain(s[a]) for a in axes), str(s["repeats"])]
        for i, s in enumerate(settings, start=1)
    ]
    lead = f"This {settings[0]['purpose']}."
    if "lambda_now" in settings[0]:
        now, after, enough = (settings[0][f"lambda_{when}"] for when in ("now", "after", "enough"))
        lead += (
            f" These data already do (separation {_figure(now)}, {enough:.0f} is enough); the"
            " settings confirm it."
            if now >= enough
            else (
                f" Their separation: now {_figure(now)}, then {_figure(after)}; {enough:.0f} is"
                " enough for a name."
            )
        )
    return f"<p>{escape(lead)}</p>{_rows(head, rows)}"


def _out_of_sight(content: Mapping[str, Any]) -> str:
    """Effects that would be hidden at their usual size, and what would show each."""
    rows = [
        [words(e["name"]), "no" if e["sweep"] is None else sweep_said(e["sweep"]), e["check"]]
        for e in content["out_of_sight"]
    ]
    if not rows:
        return ""
    lead = (
        "Each of these, as large as it usually is, would as a rule have stayed without a name in"
        " these data. That they are not named says nothing about them."
    )
    head = ["effect", "a sweep of friction that shows it", "physical check"]
    return f"<p>{lead}</p>{_rows(head, rows)}"


def sweep_said(sweep: Mapping[str, Any]) -> str:
    """One axis and what the others stand at."""
    at = [_from_to(axis, value, value) for axis, value in sweep["at"].items() if axis != "time_s"]
    over = _from_to(sweep["axis"], sweep["low"], sweep["high"])
    return f"{over} at {_and(at)}, {sweep['settings']} settings"


def _provenance(content: Mapping[str, Any]) -> str:
    parent, versions = content["parent_model"], content["versions"]
    items = [
        f"Data: {content['data'].get('file') or 'not named'}, sha256 {content['data']['hash']}",
        f"Model: {parent['name']}, {parent['hash']}; written to {Path(content['model']).name}",
        (
            f"Seed {content['seed']}; {versions['program']}, numpy {versions['numpy']}, scipy"
            f" {versions['scipy']}"
        ),
    ]
    return _list(items)


def _list(items: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>" if items else ""


def _rows(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f'<div class="wide"><table><tr>{top}</tr>{body}</table></div>'


def _image(drawn: Mapping[str, bytes], name: str, alternative: str) -> str:
    """A picture in the page itself, at a size that gives all of them the same letters."""
    if name not in drawn:
        return ""
    svg = drawn[name]
    width = round(PIXELS * float(svg.partition(b'width="')[2].partition(b"pt")[0]))
    source = base64.b64encode(svg).decode()
    return (
        f'<img alt="{escape(alternative)}" style="width:{width}px"'
        f' src="data:image/svg+xml;base64,{source}">'
    )


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _and(items: Sequence[str], word: str = "and") -> str:
    return (
        f" {word} ".join(items) if len(items) < 3 else f"{', '.join(items[:-1])} {word} {items[-1]}"
    )


def _probability(value: float | None) -> str:
    if value is None:
        return "–"
    return "above 0.999" if value > 0.999 else "below 0.001" if value < 0.001 else f"{value:.3f}"


def _share(value: float) -> str:
    """Of a gap; beyond all of it the figure says no more."""
    if abs(value) > 1.0:
        return "over 100 %" if value > 0.0 else "below -100 %"
    return f"{100.0 * value:.0f} %"


def _figure(value: float | None) -> str:
    return "unknown" if value is None else _plain(value, 3)
