"""`haptic texture import`: what was measured or recorded elsewhere, as a texture of the library's
format.
"""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from typer import Argument, Option

from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.errors import BadInputError, require_range
from haptic_driver.files import exists_already, write_rows, write_text
from haptic_driver.lab.commands.columns import ColumnOption, MapOption, columns_named, refuse_both
from haptic_driver.render.texture import Outside
from model.support.toml import toml_lines

if TYPE_CHECKING:
    from haptic_driver.lab.importers.strokes import Strokes
    from haptic_driver.signals import Array

RECORDINGS, TABLES, SOUNDS, MODELS = (".h5", ".hdf5"), (".csv",), (".wav",), (".xml",)
SPEED_M_S = (0.005, 1.0)  # of a surface's vibration
PITCH_MM = (0.02, 10.0)


class Imported(NamedTuple):
    """A profile [n] and how the texture's file goes on; `found` is for `--json`."""

    position_m: Array
    cof: Array
    words: str
    outside: Outside
    direction_deg: float
    found: dict[str, Any]


def texture_import(
    source: Annotated[
        Path,
        Argument(
            help="Recording (.h5), strokes (.csv), vibration (.wav), HaTT models (.xml), or a trial"
            " (--map)."
        ),
    ],
    out: Annotated[Path, Option(help="Texture to write, .toml; points go into a .csv beside it.")],
    run: Annotated[
        str | None, Option(help=".h5: the run, e.g. run_0001; the last one by default.")
    ] = None,
    column: ColumnOption = None,
    map_file: MapOption = None,
    pitch_mm: Annotated[
        float, Option(help=".h5, .csv, trials: width of the places that friction is averaged over.")
    ] = 0.1,
    speed: Annotated[
        float | None, Option(help=".wav: m/s at which the surface vibrates so.")
    ] = None,
    mean_cof: Annotated[
        float | None, Option(help=".wav, .xml: mean friction; .xml: the file's own mu if not said.")
    ] = None,
    amplitude_cof: Annotated[
        float | None, Option(help=".wav: largest deviation from the mean.")
    ] = None,
    cof_rms: Annotated[
        float | None,
        Option(
            help=".xml: friction (rms) of the model that vibrates most; the others in proportion."
        ),
    ] = None,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Make a texture of a recording, of strokes measured elsewhere, of a surface's vibration or of
    HaTT models.

    A recording and strokes (columns position_mm, normal_force_n, lateral_force_n) give friction
    over position. A vibration has no friction: say which it shall have. HaTT models give a texture
    that changes with speed and load.

    With `--map` the source is a raw trial file that `haptic rows` can read, of whatever ending.

    Example: `haptic texture import strokes.csv --out mine.toml`
    """
    refuse_both(map_file, column)
    points = out.with_suffix(".csv")
    kind = "" if map_file is not None else source.suffix.lower()
    read = [source] if map_file is None else [source, map_file]
    _require_free(read, [out] if kind in MODELS else [out, points], force)
    if kind in MODELS:
        payload = _modelled(source, mean_cof, cof_rms, out)
    elif kind in SOUNDS:
        made = _vibrating(source, speed, mean_cof, amplitude_cof)
        payload = _write(made, source, out, points)
    else:
        if map_file is not None:
            strokes, direction_deg = _of_trial(source, map_file), 0.0
        elif kind in RECORDINGS:
            strokes, direction_deg = _recorded(source, run)
        else:
            strokes, direction_deg = _of_table(source, column), 0.0
        made = _felt(strokes, direction_deg, pitch_mm, str(source))
        payload = _write(made, source, out, points)
    report(as_json, payload, lambda: _show(payload))


def _require_free(read: list[Path], written: list[Path], force: bool) -> None:
    out = written[0]
    if out.suffix.lower() != ".toml":
        raise BadInputError(
            "bad_ending", f"{out}: does not end in .toml", f"Give --out {out.with_suffix('.toml')}"
        )
    for path in written:
        if path.exists() and any(source.exists() and path.samefile(source) for source in read):
            said = f"{path}: is read, and would be overwritten"
            raise BadInputError("file_exists", said, "Give another --out")
        if path.exists() and not force:
            raise exists_already(path)


def _of_trial(source: Path, map_file: Path) -> Strokes:
    from haptic_driver.lab.raw_trials.strokes import (  # noqa: PLC0415  (as all below: slow)
        strokes_of,
    )

    return strokes_of(source, map_file)


def _of_table(source: Path, column: list[str] | None) -> Strokes:
    from haptic_driver.lab.importers import strokes  # noqa: PLC0415

    if source.suffix.lower() not in TABLES:
        known = ", ".join((*RECORDINGS, *TABLES, *SOUNDS, *MODELS))
        said = f"{source}: '{source.suffix}' is not a file that can be imported"
        raise BadInputError("bad_ending", said, f"Known: {known}; other trial files with --map")
    return strokes.read_strokes(source, columns_named(column, strokes.COLUMNS, "position_mm=x"))


def _recorded(source: Path, run: str | None) -> tuple[Strokes, float]:
    """The strokes of a recording along the axis that it slides farther, and that axis' direction in
    degrees.
    """
    import numpy as np  # noqa: PLC0415

    from haptic_driver.lab.importers.strokes import Strokes  # noqa: PLC0415
    from haptic_driver.recording.read import read_run  # noqa: PLC0415

    samples = read_run(source, run).samples
    touching = samples[samples["in_contact"] == 1]
    if not touching.size:
        hint = "Give another --run, or record while a finger slides"
        raise BadInputError("bad_strokes", f"{source}: nobody touches in this run", hint)
    axis, direction_deg = max(
        (("x", 0.0), ("y", 90.0)), key=lambda a: float(np.ptp(touching[f"position_{a[0]}_m"]))
    )
    columns = (f"position_{axis}_m", "normal_force_n", "lateral_force_n", "speed_m_s")
    return Strokes(*(np.asarray(touching[name], float) for name in columns)), direction_deg


def _felt(strokes: Strokes, direction_deg: float, pitch_mm: float, where: str) -> Imported:
    from haptic_driver.lab.importers.strokes import friction_over_position  # noqa: PLC0415

    require_range("--pitch-mm", pitch_mm, *PITCH_MM, unit=" mm")
    felt = friction_over_position(strokes, pitch_mm * 1e-3, where)
    found = {
        "share_used": felt.share_used,
        "widest_gap_mm": 1e3 * felt.widest_gap_m,
        "speed_m_s": felt.speed_m_s,
        "length_mm": 1e3 * float(felt.position_m[-1] - felt.position_m[0]),
    }
    words = (
        f"{felt.share_used:.1%} of the rows count: they slide in contact; longest way without any"
        f" {1e3 * felt.widest_gap_m:.3g} mm"
    )
    return Imported(felt.position_m, felt.cof, words, "nothing", direction_deg, found)


def _vibrating(
    source: Path, speed_m_s: float | None, mean_cof: float | None, amplitude_cof: float | None
) -> Imported:
    import numpy as np  # noqa: PLC0415

    from haptic_driver.lab.importers import vibration  # noqa: PLC0415
    from haptic_driver.textures.description import require_swing  # noqa: PLC0415

    if speed_m_s is None or amplitude_cof is None or mean_cof is None:
        said = (
            f"{source} holds a vibration: it does not say which friction that is, nor how long the"
            " surface"
        )
        raise _needs_scale(said, "--speed 0.05 --mean-cof 0.65 --amplitude-cof 0.1")
    require_range("--speed", speed_m_s, *SPEED_M_S, unit=" m/s")
    try:
        require_swing(mean_cof, amplitude_cof)
    except ValueError as error:
        raise BadInputError(
            "out_of_range", str(error), "Give another --mean-cof or --amplitude-cof"
        ) from None
    vibrating = vibration.read_wav(source)
    position_m, cof = vibration.along_the_way(
        vibrating, speed_m_s, mean_cof, amplitude_cof, str(source)
    )
    found = {
        "length_mm": 1e3 * float(np.ptp(position_m)),
        "speed_m_s": speed_m_s,
        "rate_hz": vibrating.rate_hz,
    }
    words = (
        "the vibration's shape at that speed; its size in friction is what you said, not measured"
    )
    return Imported(position_m, cof, words, "tile", 0.0, found)


def _modelled(
    source: Path, mean_cof: float | None, cof_rms: float | None, out: Path
) -> dict[str, Any]:
    """Write all models of a file as processes; return the report."""
    from haptic_driver.lab.importers import hatt  # noqa: PLC0415
    from haptic_driver.textures import description  # noqa: PLC0415
    from haptic_driver.textures.spectrum import spectrum  # noqa: PLC0415

    if cof_rms is None:
        raise _needs_scale(
            f"{source} holds vibrations: it does not say how much friction they are",
            "--cof-rms 0.02",
        )
    models = hatt.read(source)
    head = {
        "kind": "spectrum",
        "description": _printable(
            f"from {source.name}: its size in friction is what you said, not measured"
        ),
        "mean_cof": models.mu if mean_cof is None else mean_cof,
        "rate_hz": models.rate_hz,
    }
    tables = models.described(cof_rms)
    described = description.parse(head | {"process": tables}, source)
    assert isinstance(described, description.SpectrumDescription)
    made = spectrum(described, str(source))
    write_text(out, "\n[[process]]\n".join(toml_lines(table) for table in [head, *tables]))
    return {
        "texture": str(out),
        "processes": len(tables),
        "speed_m_s": [1e-3 * end(one.speed_mm_s for one in models.processes) for end in (min, max)],
        "normal_force_n": [
            end(one.normal_force_n for one in models.processes) for end in (min, max)
        ],
        "cof": list(made.bounds()),
    }


def _write(made: Imported, source: Path, out: Path, points: Path) -> dict[str, Any]:
    """Points first: a texture's file never names one that is not there. Return the report."""
    places = zip((1e3 * made.position_m).tolist(), made.cof.tolist(), strict=True)
    write_rows(
        points,
        [{"position_mm": f"{place_mm:.9g}", "cof": f"{cof:.5f}"} for place_mm, cof in places],
    )
    texture = {
        "kind": "profile",
        "description": _printable(f"from {source.name}: {made.words}"),
        "file": _printable(points.name),
        "direction_deg": made.direction_deg,
        "outside": made.outside,
    }
    write_text(out, toml_lines(texture))
    return {
        "texture": str(out),
        "points_file": str(points),
        "points": made.cof.size,
        "cof": [float(made.cof.min()), float(made.cof.max())],
        "words": made.words,
    } | made.found


def _needs_scale(said: str, example: str) -> BadInputError:
    return BadInputError("texture_needs_scale", said, f"Add for example: {example}")


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _show(payload: dict[str, Any]) -> None:
    low, high = payload["cof"]
    if "processes" in payload:
        speeds, loads = (
            "{:.3g} to {:.3g}".format(*payload[name]) for name in ("speed_m_s", "normal_force_n")
        )
        stdout.print(f"texture: {payload['texture']}")
        stdout.print(f"  {payload['processes']} processes for {speeds} m/s and {loads} N")
        stdout.print(f"  friction {low:.4g} to {high:.4g}")
        stdout.print("  its size in friction is what you said, not measured")
    else:
        speed_m_s = payload["speed_m_s"]
        at = "" if math.isnan(speed_m_s) else f", at {speed_m_s:.3g} m/s"
        length = f"{payload['points']} points over {payload['length_mm']:.4g} mm"
        stdout.print(f"texture: {payload['texture']}, with its points in {payload['points_file']}")
        stdout.print(f"  {length}, friction {low:.4g} to {high:.4g}{at}")
        stdout.print(f"  {payload['words']}")
    stdout.print(f"look at it: haptic texture preview {shlex.quote(payload['texture'])}")
