"""Pictures of a diagnosis, each to be understood at a glance: PNG bytes by name."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from scipy.linalg import solve_triangular

from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import Candidate
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.noise import shared_std
from model.diagnosis.priors import NONE, SURE, UNKNOWN, words
from model.diagnosis.where import Region
from model.diagnosis.witness import FRICTION, WITNESSES
from model.diagnosis.workflow import Diagnosis, Findings
from model.effects.learned import LOG_INPUTS
from model.reporting.bode import AFTER, BEFORE, DATA, spectrum
from model.support.arrays import Array, Mask

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

QUIET = "#9aa0a6"
LEADING = ("#1b6ca8", "#e08e0b", "#5b8c5a")
AXES = {
    "frequency_hz": "frequency, Hz",
    "voltage_v": "voltage, V peak",
    "normal_force_n": "normal force, N",
    "speed_m_s": "sliding speed, m/s",
    "time_s": "time, s",
    "voltage_offset_v": "bias, V",
}
DRIVEN_ONLY = ("frequency_hz",)
# along one side of a map: levels, or ranges where there are more levels
MOST_CELLS, MOST_RANGES = 12, 8
LABEL = 0.14  # of the width of an axis: a label of three digits
MOST_BARS = 8
LEAST_BAR = 1e-4
LONGEST_NAME = 24
OUTLINED = 2
PLATE = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75}


def pictures(diagnosis: Diagnosis) -> dict[str, bytes]:
    """Every picture that the diagnosis has data for; none where nothing could be tested."""
    data, found = diagnosis.data, diagnosis.findings
    if found is None:
        return {}
    friction = data.of(FRICTION).any()
    drawn = {
        "residual_map": residual_map(data, found) if friction else None,
        "residual_over_time": residual_over_time(data, found) if friction else None,
        **{
            f"fingerprint{'' if w == FRICTION else f'_{w}'}": fingerprint(data, found, w)
            for w in data.witnesses
        },
        "spectrum": spectrum(data, found),
        "probabilities": probability_bars(found),
        "held_out": held_out(found),
    }
    return {name: _svg(figure) for name, figure in drawn.items() if figure is not None}


def residual_percent(
    problem: Problem, fit: Fit, data: Measurements, witness: int = FRICTION
) -> Array:
    """Measured against predicted for one witness, in percent, without what sessions share.

    Of a phase, hundredths of a rad.
    """
    return percent(_unshared(problem, fit, data), witness)[data.of(witness)]


def _unshared(problem: Problem, fit: Fit, data: Measurements) -> Array:
    """Measured against predicted [n], as differences of logarithms, without what sessions share."""
    raw = problem.predictor.less(
        problem.observed, problem.predictor.predicted(fit.kinds, fit.vector[None])[0]
    )
    raw = np.where(np.isfinite(raw), raw, 0.0)
    weighed = solve_triangular(problem.noise.lower.T, problem.noise.whiten(raw), lower=False)
    shared = [
        std * np.bincount(data.group, std * weighed)[data.group] for std in shared_std(data).T
    ]
    return np.asarray(raw - np.sum(shared, axis=0))


def percent(difference: Array, witness: int) -> Array:
    """A difference of logarithms in percent; one of phases in hundredths of a rad."""
    return np.asarray(100.0 * (difference if WITNESSES[witness].is_phase else np.expm1(difference)))


def _before_after(data: Measurements, found: Findings) -> list[tuple[str, str, Array]]:
    """Title, colour and residuals of the base model, and of the chosen one where it has an
    effect.
    """
    models = [("model as given", BEFORE, found.hypotheses.base.fit)]
    chosen = found.chosen
    if chosen.kinds:
        models.append((f"with {words(chosen.name)}", AFTER, chosen.fit))
    return [
        (title, colour, residual_percent(found.problem, fit, data)) for title, colour, fit in models
    ]


def residual_map(data: Measurements, found: Findings) -> Figure:
    """Mean residual over frequency and voltage, before and after, with the regions that disagree
    outlined.
    """
    panels = _before_after(data, found)
    data = data.subset(data.of(FRICTION))
    columns, frequency_names = _cells(data.columns["frequency_hz"], data.driven)
    rows, voltage_names = _cells(data.columns["voltage_v"], data.driven)
    quiet = bool((~data.driven).any())
    maps = [_means(values, data.driven, rows, columns) for *_, values in panels]
    limit = max(2.0, *(float(np.nanmax(np.abs(m))) for m in maps))
    height = 2.5 + 0.42 * (len(voltage_names) + quiet)
    figure, axes = _side_by_side(len(panels), max(8.2, 5.9 * len(panels) + 0.4), height)
    for ax, (title, colour, values), means in zip(axes, panels, maps, strict=True):
        ax.pcolormesh(
            means, cmap="RdBu_r", vmin=-limit, vmax=limit, edgecolors="white", linewidth=1.5
        )
        _write_cells(ax, means, limit, 0.0)
        if quiet:
            still = np.array([[float(np.mean(values[~data.driven]))]])
            edges = [0.0, float(len(frequency_names))]
            ax.pcolormesh(edges, [-1.25, -0.25], still, cmap="RdBu_r", vmin=-limit, vmax=limit)
            _write_cells(ax, still, limit, -1.25, edges[1])
        ax.set_xticks(np.arange(len(frequency_names)) + 0.5, frequency_names)
        heights = [*np.arange(len(voltage_names)) + 0.5, *([-0.75] if quiet else [])]
        ax.set_yticks(heights, [*voltage_names, *(["no voltage"] if quiet else [])])
        ax.set(xlabel="frequency, Hz", facecolor="#eeeeee")
        ax.set_title(title, color=colour, fontweight="bold")
        ax.tick_params(length=0)
        ax.spines[:].set_visible(False)
    axes[0].set_ylabel("voltage, V peak")
    regions = [region for region in found.before.certain if region.witness == FRICTION]
    shown = [r for r in regions if set(r.axes) <= {"frequency_hz", "voltage_v"}][:OUTLINED]
    for region in shown:
        _outline(axes[0], region, data, columns, rows, quiet)
    scale = ScalarMappable(Normalize(-limit, limit), "RdBu_r")
    figure.colorbar(scale, ax=axes, label="measured minus\npredicted, % of friction", aspect=12)
    note = (
        "outlined: disagrees beyond chance"
        if shown
        else "no region of this map stands out beyond chance"
    )
    if regions and not shown:
        note = (
            f"the disagreement lies along {AXES[regions[0].axes[-1]].split(',')[0]}, see the"
            " fingerprint"
        )
    figure.suptitle(f"Where measured and predicted friction differ\n({note})", fontsize=11)
    return figure


def _side_by_side(panels: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    figure, axes = plt.subplots(
        1, panels, figsize=(width, height), sharey=True, squeeze=False, layout="constrained"
    )
    return figure, axes[0].tolist()


def _cells(values: Array, allowed: Mask) -> tuple[Array, list[str]]:
    """The cell of each row along one side of a map, -1 where not allowed; and the cells' names."""
    levels = np.unique(values[allowed])
    if levels.size <= MOST_CELLS:
        groups = [np.array([level]) for level in levels]
    else:
        groups = [g for g in np.array_split(levels, MOST_RANGES) if g.size]
    edges = np.array([g[0] for g in groups])
    cell = np.where(allowed, np.searchsorted(edges, values, side="right") - 1, -1)
    return cell, [
        _short(g[0]) if g.size == 1 else f"{_short(g[0])}–\n{_short(g[-1])}" for g in groups
    ]


def _short(value: float) -> str:
    for factor, suffix in ((1e6, " M"), (1e3, " k")):
        if abs(value) >= factor:
            return f"{value / factor:.3g}{suffix}"
    return f"{value:.3g}"


def _means(values: Array, allowed: Mask, rows: Array, columns: Array) -> Array:
    shape = (int(rows.max()) + 1, int(columns.max()) + 1)
    flat = np.ravel_multi_index((rows[allowed].astype(int), columns[allowed].astype(int)), shape)
    count = np.bincount(flat, minlength=shape[0] * shape[1])
    total = np.bincount(flat, values[allowed], minlength=shape[0] * shape[1])
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(shape)


def _write_cells(ax: Axes, means: Array, limit: float, bottom: float, width: float = 1.0) -> None:
    for (i, j), value in np.ndenumerate(means):
        if np.isfinite(value):
            text = (
                f"{value:+.0f}"
                if abs(value) >= 9.95
                else "0"
                if abs(value) < 0.05
                else f"{value:+.1f}"
            )
            colour = "white" if abs(value) > 0.6 * limit else DATA
            ax.text(
                (j + 0.5) * width,
                bottom + i + 0.5,
                text,
                ha="center",
                va="center",
                fontsize=8,
                color=colour,
            )


def _outline(
    ax: Axes, region: Region, data: Measurements, columns: Array, rows: Array, quiet: bool
) -> None:
    """A frame around the cells of one region; the whole height or width along an input that it
    leaves open.
    """
    span = {"frequency_hz": (0, int(columns.max()) + 1), "voltage_v": (0, int(rows.max()) + 1)}
    for axis, low, high in zip(region.axes, region.low, region.high, strict=True):
        values = data.columns[axis]
        cell = (columns if axis == "frequency_hz" else rows)[
            (values >= low) & (values <= high) & data.driven
        ]
        if cell.size:
            span[axis] = (int(cell.min()), int(cell.max()) + 1)
    (left, right), (low_row, high_row) = span["frequency_hz"], span["voltage_v"]
    bottom = -1.25 if quiet and region.axes == ("voltage_v",) and region.low[0] == 0.0 else low_row
    frame = Rectangle(
        (left + 0.04, bottom + 0.04),
        right - left - 0.08,
        high_row - bottom - 0.08,
        fill=False,
        ec="black",
        lw=2.2,
        zorder=5,
    )
    ax.add_patch(frame)


def residual_over_time(data: Measurements, found: Findings) -> Figure | None:
    """Residual against time, one colour per session, with what is smooth in it; None without
    `time_s`.
    """
    if not data.varies("time_s"):
        return None
    panels = _before_after(data, found)
    data = data.subset(data.of(FRICTION))
    figure, axes = _side_by_side(len(panels), max(8.2, 5.6 * len(panels)), 3.6)
    groups = [
        (f"session {_literal(name)}", data.session == i)
        for i, name in enumerate(data.session_names)
    ]
    if len(groups) > MOST_BARS:
        groups = [("all sessions", np.ones(data.count, bool))]
    colours = plt.get_cmap("viridis")(np.linspace(0.05, 0.85, len(groups)))
    time = data.columns["time_s"]
    unit, scale = (
        ("h", 3600.0)
        if np.ptp(time) > 2e4
        else ("min", 60.0)
        if np.ptp(time) > 600.0
        else ("s", 1.0)
    )
    for ax, (title, title_colour, values) in zip(axes, panels, strict=True):
        for (name, inside), colour in zip(groups, colours, strict=True):
            rows = np.flatnonzero(inside)
            rows = rows[np.argsort(time[rows], kind="stable")]
            ax.plot(time[rows] / scale, values[rows], ".", ms=3.5, color=colour, alpha=0.55)
            ax.plot(
                time[rows] / scale,
                _running_median(values[rows]),
                "-",
                lw=1.8,
                color=colour,
                label=name,
            )
        ax.axhline(0.0, color=DATA, lw=0.8)
        ax.set_title(title, color=title_colour, fontweight="bold")
        ax.set_xlabel(f"time, {unit}")
        ax.grid(alpha=0.25)
    axes[0].set_ylabel("measured minus predicted,\n% of friction")
    axes[-1].legend(frameon=False, fontsize=8, loc="best")
    figure.suptitle("Does the difference drift? (lines: running median)", fontsize=11)
    return figure


def _running_median(values: Array) -> Array:
    half = max(2, values.size // 12)
    return np.array(
        [np.median(values[max(0, i - half) : i + half + 1]) for i in range(values.size)]
    )


def fingerprint(data: Measurements, found: Findings, witness: int = FRICTION) -> Figure | None:
    """Over every input that varies: what a witness shows, and what each leading candidate would
    make of the model.
    """
    problem, base, mine = found.problem, found.hypotheses.base, data.of(witness)
    known, names = WITNESSES[witness], [name for name in AXES if data.subset(mine).varies(name)]
    if not names:
        return None
    given = _unshared(problem, base.fit, data)
    residual = percent(given, witness)[mine]
    error = 100.0 * problem.noise.own_std[mine] * base.beside_discrepancy.scale
    changes = [
        (words(model.name), percent(given - _unshared(problem, model.fit, data), witness)[mine])
        for model in leaders(found)
    ]
    data = data.subset(mine)
    wide = min(len(names), 3)
    high = -(-len(names) // wide)
    size = (4.1 * wide + 0.6, 3.3 * high + 0.9)
    figure, axes = plt.subplots(
        high, wide, figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for ax, name in zip(axes.flat, names, strict=False):
        _profile(ax, data, name, residual, error, changes)
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    for row in axes:
        row[0].set_ylabel(f"change of {known.words} against\nthe model as given, {known.unit}")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(
        f"Fingerprint{'' if witness == FRICTION else f' in the {known.words}'}: what the data show"
        " (points), and what each candidate, fitted to them, would make (lines)",
        fontsize=11,
    )
    return figure


def leaders(found: Findings, most: int = 3) -> list[Candidate]:
    """The chosen model where it has effects, then the most probable single effects."""
    chosen, probabilities = found.chosen, found.verdict.posterior.shares
    others = sorted(
        (c for c in found.hypotheses.singles if c.kinds != chosen.kinds),
        key=lambda c: (-probabilities[c.name], -c.alone.log_evidence),
    )
    return [*([chosen] if chosen.kinds else []), *others][:most]


def _profile(
    ax: Axes,
    data: Measurements,
    name: str,
    residual: Array,
    error: Array,
    changes: Sequence[tuple[str, Array]],
) -> None:
    allowed = data.driven if name in DRIVEN_ONLY else np.ones(data.count, bool)
    values = data.columns[name]
    cell, _ = _cells(values, allowed)
    cells = range(int(cell.max()) + 1)
    at = np.array([values[cell == i].mean() for i in cells])
    mean = np.array([residual[cell == i].mean() for i in cells])
    bar = np.array([np.sqrt(np.sum(error[cell == i] ** 2)) / np.sum(cell == i) for i in cells])
    ax.axhline(0.0, color=QUIET, lw=1.0)
    for i, ((label, change), colour) in enumerate(zip(changes, LEADING, strict=False)):
        line = [change[cell == i].mean() for i in cells]
        ax.plot(at, line, "-" if i == 0 else "--", color=colour, lw=2.4 - 0.5 * i, label=label)
    ax.errorbar(
        at, mean, bar, fmt="o", ms=5, color=DATA, capsize=2.5, lw=1.2, label="measured, ± noise"
    )
    if name in LOG_INPUTS and at.min() > 0.0:
        ax.set_xscale("log")
        if at.max() < 30.0 * at.min():
            ticks = _apart(at)
            ax.set_xticks(ticks, [f"{v:.3g}" for v in ticks])
            ax.minorticks_off()
    ax.set_xlabel(AXES[name] + (", rows with voltage" if name in DRIVEN_ONLY else ""))
    ax.grid(alpha=0.25)


def _apart(levels: Array) -> list[float]:
    """Those of rising levels whose labels do not touch on a logarithmic axis of them all."""
    least = LABEL * np.log(levels[-1] / levels[0])
    kept = [float(levels[0])]
    for level in levels[1:]:
        if np.log(level / kept[-1]) >= least:
            kept.append(float(level))
    return kept


def probability_bars(found: Findings) -> Figure:
    """The most probable candidates on a logarithmic scale, with none and unknown always among
    them.
    """
    verdict, untestable = found.verdict, found.hypotheses.untestable
    probabilities = verdict.posterior.inclusion
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    kept = [name for name in ranked if name not in (NONE, UNKNOWN)][:MOST_BARS]
    shown = [name for name in ranked if name in (*kept, NONE, UNKNOWN)]
    named = {kind.name for kind in verdict.chosen.kinds}
    alike = {name for names in verdict.group.values() for name in names}
    figure, ax = plt.subplots(figsize=(8.2, 0.8 + 0.36 * len(shown)), layout="constrained")
    for i, name in enumerate(shown):
        p = probabilities[name]
        colour = (
            QUIET
            if name in (NONE, UNKNOWN)
            else AFTER
            if name in named
            else "#7fb2d6"
            if name in alike
            else "#c9d6df"
        )
        hatch = "////" if name == UNKNOWN else None
        ax.barh(
            i,
            max(p, LEAST_BAR),
            left=0.0,
            color=colour,
            hatch=hatch,
            edgecolor="white",
            height=0.72,
        )
        text = f"{p:.3f}" if p >= 0.001 else f"{p:.0e}" if p >= LEAST_BAR else "below 0.0001"
        if p > 0.999 and len(ranked) > 1:
            text = "above 0.999"
        ax.text(max(p, LEAST_BAR) * 1.12, i, text, va="center", fontsize=9, color=DATA, bbox=PLATE)
    ax.axvline(SURE, color=BEFORE, lw=1.2, ls=":")
    ax.text(SURE, -0.75, "needed for a name", color=BEFORE, fontsize=8, ha="right", va="center")
    ax.set_yticks(
        range(len(shown)), [words(name) + _mark(name, named, alike, untestable) for name in shown]
    )
    ax.set(
        xscale="log",
        xlim=(0.5 * LEAST_BAR, 4.0),
        ylim=(len(shown) - 0.5, -1.1),
        xlabel="probability (logarithmic)",
    )
    ax.set_xticks([1e-4, 1e-3, 1e-2, 1e-1, 1.0], ["0.0001", "0.001", "0.01", "0.1", "1"])
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title("Which effect is missing?", fontsize=11)
    return figure


def _mark(name: str, named: set[str], alike: set[str], untestable: Sequence[str]) -> str:
    if name in untestable:
        return " (no data on it)"
    return "  ●" if name in named else "  ○" if name in alike else ""


def held_out(found: Findings) -> Figure | None:
    """Squared error on data that no fit has seen, fold by fold, before and after; noise alone gives
    1.
    """
    proof, chosen = found.proof, found.chosen
    if not proof.before.size:
        return None
    count = proof.before.size
    figure, ax = plt.subplots(
        figsize=(min(max(6.4, 1.3 * count + 2.4), 16.0), 3.6), layout="constrained"
    )
    at = np.arange(count)
    both: list[tuple[str, Array, str, float]] = [("model as given", proof.before, BEFORE, -0.19)]
    if chosen.kinds:
        both.append(
            (f"with the effect chosen anew ({words(chosen.name)})", proof.after, AFTER, 0.19)
        )
    top = max(1.2, *(float(np.nanmax(values)) for _, values, _, _ in both))
    low = 0.3 if top > 20.0 else 0.0  # of the axis, which is logarithmic then
    for label, values, colour, shift in both:
        place = at + (shift if len(both) > 1 else 0.0)
        ax.bar(place, values, 0.36, color=colour, label=label)
        for x, value in zip(place, np.maximum(values, 0.0), strict=True):
            text = f"{value:.0f}" if value >= 9.95 else f"{value:.2f}"
            ax.text(
                x,
                max(value, low),
                text,
                ha="center",
                va="bottom",
                fontsize=8,
                color=DATA,
                bbox=PLATE,
                zorder=4,
            )
    ax.axhline(1.0, color=DATA, lw=1.4, ls="--", label="noise alone")
    if low > 0.0:
        ax.set(yscale="log", ylim=(low, 2.0 * top))
    else:
        ax.set_ylim(0.0, 1.12 * top)
    names = [f"session {_literal(n)}" if proof.by == "session" else n for n in proof.folds]
    ax.set_xticks(at, names, rotation=90 if count > 12 else 30 if count > 6 else 0)
    ax.set_ylabel("squared error per point,\nin units of the noise")
    ax.grid(alpha=0.25, axis="y")
    ax.set_axisbelow(True)
    ax.legend(frameon=False, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    figure.suptitle(
        f"Proof: error on each {proof.by} while it was left out of the fit", fontsize=11
    )
    return figure


def _literal(text: str) -> str:
    """A name out of a file as it stands: not taken for a formula, and not too long. What does not
    print, which no SVG may hold, is escaped.
    """
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return (text if len(text) <= LONGEST_NAME else text[: LONGEST_NAME - 1] + "…").replace(
        "$", r"\$"
    )


def _svg(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    with plt.rc_context({"svg.hashsalt": "haptic"}):  # the same file again from the same data
        # Not `savefig`, which draws everything twice, the first time for the layout alone.
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]
    plt.close(figure)
    return buffer.getvalue()
