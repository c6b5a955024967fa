"""`haptic texture import`: what was measured or recorded elsewhere, as a texture of the library's
format.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.errors import BadInputError, require_range
from haptic_driver.files import require_ending, require_free, write_rows, write_text
from haptic_driver.lab.commands.columns import ColumnOption, MapOption, columns_named, refuse_both
from model.support.toml import toml_lines

if TYPE_CHECKING:
    from haptic_driver.lab.importers import Made


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
    perceptual_gain: Annotated[
        float | None,
        Option(
            help="By which variation about the mean is played stronger: 3 for .csv and trials, else"
            " 1. A fine texture is taken for the original at 3, a coarse one at 5."
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

    Strokes on a real surface are played stronger than recorded, since else they feel weak; the
    points stay as recorded. For friction in true size: `--perceptual-gain 1`.

    With `--map` the source is a raw trial file that `haptic rows` can read, of whatever ending.

    Example: `haptic texture import strokes.csv --out mine.toml`
    """
    refuse_both(map_file, column)
    require_ending(out, [".toml"])
    # slow, as strokes
    from haptic_driver.lab.importers import Asked, importer_of, usual_gain  # noqa: PLC0415
    from haptic_driver.lab.importers.strokes import COLUMNS  # noqa: PLC0415
    from haptic_driver.textures.description import GAINS  # noqa: PLC0415

    named = columns_named(column, COLUMNS, "position_mm=x")
    gain = usual_gain(source, map_file) if perceptual_gain is None else perceptual_gain
    require_range("--perceptual-gain", gain, *GAINS)
    said = (speed, mean_cof, amplitude_cof, cof_rms, gain)
    asked = Asked(run, named, map_file, pitch_mm * 1e-3, *said)
    made = importer_of(source, map_file)(source, asked)
    points = out.with_suffix(".csv")
    written = [out] if made.profile is None else [out, points]
    _require_apart([source] if map_file is None else [source, map_file], written, force)
    payload = _write(made, source, out, points)
    report(as_json, payload, lambda: _show(made, payload))


def _require_apart(read: list[Path], written: list[Path], force: bool) -> None:
    for path in written:
        if path.exists() and any(path.samefile(source) for source in read):
            said = f"{path}: is read, and would be overwritten"
            raise BadInputError("file_exists", said, "Give another --out")
        require_free(path, force)


def _write(made: Made, source: Path, out: Path, points: Path) -> dict[str, Any]:
    """Points first: a texture's file never names one that is not there. Return the report."""
    head, files = made.head, {"texture": str(out)}
    head |= {"description": _printable(f"from {source.name}: {head['description']}")}
    if made.profile is not None:
        position_m, cof = (values.tolist() for values in made.profile)
        rows = [
            {"position_mm": f"{1e3 * at_m:.9g}", "cof": f"{value:.5f}"}
            for at_m, value in zip(position_m, cof, strict=True)
        ]
        write_rows(points, rows)
        head |= {"file": _printable(points.name)}
        files |= {"points_file": str(points)}
    write_text(out, "\n[[process]]\n".join(toml_lines(each) for each in (head, *made.processes)))
    return files | made.found


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _show(made: Made, payload: dict[str, Any]) -> None:
    points = f", with its points in {payload['points_file']}" if made.profile is not None else ""
    stdout.print(f"texture: {payload['texture']}{points}")
    for line in made.shown:
        stdout.print(f"  {line}")
    stdout.print(f"look at it: haptic texture preview {shlex.quote(payload['texture'])}")
