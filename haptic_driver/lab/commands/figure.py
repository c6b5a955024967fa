"""`haptic figure`: the paper's figures 3 and 7(a) from one's own data."""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from haptic_driver.cli.output import Json, ModelOption, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.files import write_rows
from haptic_driver.lab.strokes.means import StrokeMeans, stroke_means
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.support.reading import read_text
from model.touch_model import TouchModel

if TYPE_CHECKING:
    from haptic_driver.lab.figures.figure3 import ModelCurve

POINTS = 121  # of a model's curve
WANTED = ("voltage_v", "normal_force_n", "speed_m_s")


def figure(
    data: Annotated[Path, Argument(help="CSV of haptic measure; its strokes lie beside it.")],
    out: Annotated[
        Path, Option(help="Folder, or the name of figure 3: .png, .pdf or .svg.")
    ] = Path("figures"),
    model: ModelOption = "reference",
    diagnosis: Annotated[
        Path | None, Option(help="Folder of haptic diagnose: its corrected model is drawn too.")
    ] = None,
    voltage: Annotated[float | None, Option(help="Of several, this amplitude, V.")] = None,
    normal_force: Annotated[float | None, Option(help="Of several, this load, N.")] = None,
    speed: Annotated[float | None, Option(help="Of several, this speed, m/s.")] = None,
    as_json: Json = False,
) -> None:
    """Draw friction over displacement and frequency, and the force that it implies, with a model's.

    Means over trials with standard errors, the steady window drawn in. The force is inferred by
    equation (31) as printed and as corrected. Numbers are written beside the pictures.

    Example: `haptic figure data.csv --out figures`
    """
    asked = dict(zip(WANTED, (voltage, normal_force, speed), strict=True))
    means = stroke_means(data, {name: value for name, value in asked.items() if value is not None})
    files = draw(means, out, curves_of(means, model, diagnosis))
    report(as_json, payload(means, files), lambda: show(means, files))


def draw(means: StrokeMeans, out: Path, models: Sequence[ModelCurve]) -> list[Path]:
    """Write pictures and tables, into the folder `out` or beside the picture `out`."""
    # matplotlib is slow to import
    from haptic_driver.lab.figures.figure3 import draw_figure3, draw_figure7a  # noqa: PLC0415

    named = bool(out.suffix)
    first = out if named else out / "figure-3.png"
    second = out.with_stem(f"{out.stem}-7a") if named else out / "figure-7a.png"
    draw_figure3(means, models, first)
    draw_figure7a(means, models, second)
    steady, strokes = first.with_suffix(".csv"), first.with_name(f"{first.stem}-strokes.csv")
    write_rows(steady, _steady_rows(means))
    write_rows(strokes, _curve_rows(means))
    return [first, second, steady, strokes]


def curves_of(means: StrokeMeans, model: str, diagnosis: Path | None) -> list[ModelCurve]:
    """What the models say under the condition of the data."""
    from haptic_driver.lab.figures.figure3 import ModelCurve  # noqa: PLC0415

    asked = [(f"model {load_model(model).name}", model)]
    if diagnosis is not None:
        asked.append((_corrected_label(diagnosis), str(diagnosis / "model.toml")))
    frequencies = means.steady.frequency_hz
    f = np.geomspace(frequencies.min(), frequencies.max(), POINTS)
    v, n, s = (np.full(f.size, value) for value in means.condition)
    curves = []
    for label, name in asked:
        found = TouchModel(load_model(name)).predict(Conditions(f, v, n, speed_m_s=s))
        curves.append(ModelCurve(label, f, found.cof, found.electrostatic_force_n))
    return curves


def _corrected_label(diagnosis: Path) -> str:
    path = diagnosis / "report.json"
    if not (diagnosis / "model.toml").is_file() or not path.is_file():
        said = f"{diagnosis}: is no folder of haptic diagnose"
        raise BadInputError("no_diagnosis", said, "Give the folder that its --out named")
    try:
        names = [str(effect["name"]) for effect in json.loads(read_text(path))["effects"]]
    except (ValueError, KeyError, TypeError) as error:
        raise BadInputError("no_diagnosis", f"{path}: cannot be read ({error})") from error
    added = ", ".join(name.replace("_", " ") for name in names)
    return f"model with {added}" if added else "model as fitted"


def payload(means: StrokeMeans, files: Sequence[Path]) -> dict[str, Any]:
    """What `--json` says."""
    begin_m, end_m = means.window_m
    return {
        **means.condition._asdict(),
        "steady_window_m": [begin_m, end_m],
        "cof_off": means.steady.cof_off if isfinite(means.steady.cof_off) else None,
        "frequencies": _steady_rows(means, None),
        "left_out_hz": list(means.left_out),
        "simulated": bool(means.about.get("simulated")),
        "files": [str(file) for file in files],
    }


def show(means: StrokeMeans, files: Sequence[Path]) -> None:
    """The same for a person."""
    steady = means.steady
    counts = sorted(set(steady.trials))
    said = f"{len(counts) and counts[0]} trials" if len(counts) == 1 else f"{counts} trials"
    stdout.print(f"{means.condition}: {steady.frequency_hz.size} frequencies, {said}", markup=False)
    if steady.trials_off:
        error = f"{steady.cof_off:.3f} ± {steady.cof_off_sem:.3f}"
        stdout.print(f"friction without voltage {error} ({steady.trials_off} trials)")
    else:
        stdout.print("no force is inferred: fewer than two trials without voltage")
    for frequency_hz in means.left_out:
        stdout.print(f"left out: {frequency_hz:g} Hz, of which there is one trial")
    for file in files:
        stdout.print(str(file), markup=False)


def _steady_rows(means: StrokeMeans, missing: str | None = "") -> list[dict[str, Any]]:
    steady = means.steady
    columns = {
        "frequency_hz": steady.frequency_hz,
        "trials": steady.trials,
        "cof": steady.cof,
        "cof_sem": steady.cof_sem,
        "normal_force_n": steady.normal_force_n,
        "electrostatic_force_printed_n": steady.printed_n,
        "electrostatic_force_printed_sem_n": steady.printed_sem_n,
        "electrostatic_force_corrected_n": steady.corrected_n,
        "electrostatic_force_corrected_sem_n": steady.corrected_sem_n,
    }
    return _rows(columns, missing)


def _curve_rows(means: StrokeMeans) -> list[dict[str, Any]]:
    return [
        row
        for curve in means.curves
        for row in _rows(
            {
                "frequency_hz": [curve.frequency_hz] * curve.displacement_m.size,
                "displacement_m": curve.displacement_m,
                "cof": curve.cof,
                "cof_sem": curve.cof_sem,
                "normal_force_n": curve.normal_force_n,
                "normal_force_sem_n": curve.normal_force_sem_n,
                "velocity_m_s": curve.velocity_m_s,
                "velocity_sem_m_s": curve.velocity_sem_m_s,
            },
            "",
        )
    ]


def _rows(columns: dict[str, Any], missing: str | None) -> list[dict[str, Any]]:
    return [
        {name: _written(value, missing) for name, value in zip(columns, values, strict=True)}
        for values in zip(*columns.values(), strict=True)
    ]


def _written(value: float, missing: str | None) -> Any:
    if isinstance(value, int):
        return value
    return float(f"{value:.6g}") if isfinite(value) else missing
