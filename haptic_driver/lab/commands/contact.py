"""`haptic contact`: the contact area from a film of the fingerpad, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stdout
from haptic_driver.errors import BadInputError, HapticError, require_range
from haptic_driver.files import require_free, write_rows
from haptic_driver.lab.contact.film import Film, read_bare, read_film
from haptic_driver.lab.contact.judge import Contact, FrameSeen, Summary, Watched, summary, watch
from haptic_driver.lab.contact.scale import MM_PER_PIXEL, scale_from_ruler, scale_told
from haptic_driver.signals import Array

OUTLINES, AREAS = "outlines.png", "areas.png"


def contact(
    film: Annotated[Path, Argument(help="Video, stack of TIFF, or folder of PNG, TIFF or DNG.")],
    scale: Annotated[float | None, Option(help="Mm per pixel.")] = None,
    scale_from: Annotated[
        Path | None, Option(help="Picture of a ruler or checkerboard instead, with its --pitch.")
    ] = None,
    pitch: Annotated[
        float, Option(help="From line to line, or the side of a checkerboard's square, mm.")
    ] = 1.0,
    polarity: Annotated[
        Contact | None,
        Option(
            "--contact", help="Whether contact is dark or bright; guessed where it is not said."
        ),
    ] = None,
    background: Annotated[
        Path | None, Option(help="Picture of the screen without a finger.")
    ] = None,
    times: Annotated[Path | None, Option(help="Time stamps in s, a line per frame.")] = None,
    rate: Annotated[float | None, Option(help="Frames per second, where no file says.")] = None,
    out: Annotated[Path, Option(help="CSV to write; pictures go beside it.")] = Path("contact.csv"),
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Measure the contact area and the ridges' frame by frame, from a film of the fingerpad.

    Example: `haptic contact film.avi --scale 0.021`
    """
    mm, scale_said = _mm_per_pixel(scale, scale_from, pitch)
    if rate is not None:
        require_range("--rate", rate, 1e-3, 1e6, unit=" frames per second")
    outlines, areas = (out.with_name(f"{out.stem}-{name}") for name in (OUTLINES, AREAS))
    for path in (out, outlines, areas):
        require_free(path, force)
    opened = read_film(film, times, rate, [out, outlines, areas])
    bare = None if background is None else read_bare(background, opened)
    with progress("frames", opened.time_s.size) as advance:
        done = iter(range(1, opened.time_s.size + 1))
        watched = watch(
            opened.frames, opened.time_s, 1e-3 * mm, bare, polarity, lambda: advance(next(done))
        )
    told = summary(watched.found)
    scale_said += scale_told(mm, opened, scale_from)
    said = [*scale_said, *opened.said, *watched.said]
    write_rows(out, [_row(i, one, said) for i, one in enumerate(watched.found)])
    _draw(opened, watched, mm, (outlines, areas))
    payload: dict[str, Any] = {
        "film": str(film),
        "out": str(out),
        "pictures": [str(outlines), str(areas)],
        "mm_per_pixel": mm,
        "contact": watched.contact,
        "said": said,
        **{
            k: v if not isinstance(v, float) or isfinite(v) else None
            for k, v in asdict(told).items()
        },
    }
    if told.counted or not as_json:
        report(as_json, payload, lambda: _show(told, out, said))
    if not told.counted:
        none = f"{film}: no frame of {told.frames} counts ({_words(told)})"
        raise HapticError(
            "no_contact", none, f"Look at {outlines}; are --scale and --contact right?"
        )


def _mm_per_pixel(
    scale: float | None, ruler: Path | None, pitch_mm: float
) -> tuple[float, list[str]]:
    if (scale is None) == (ruler is None):
        said = "the scale of the film is not said" if scale is None else "the scale is said twice"
        hint = "Give --scale in mm per pixel, or --scale-from a picture of a ruler with its --pitch"
        raise BadInputError("no_scale", said, hint)
    if ruler is None:
        mm, said_of_it = scale or 0.0, []
    else:
        mm, words = scale_from_ruler(ruler, pitch_mm)
        said_of_it = [f"scale: {mm:.5g} mm per pixel, by {words}"]
    require_range("--scale", mm, *MM_PER_PIXEL, unit=" mm per pixel")
    return mm, said_of_it


def _row(number: int, one: FrameSeen, said: Sequence[str]) -> dict[str, str | float]:
    """A line of the CSV, with what is `said` of the film. A frame that does not count has no
    numbers, and says why.
    """
    row: dict[str, str | float] = {"frame": number, "time_s": f"{one.time_s:.9g}"}
    seen = one.seen if one.counts else None
    values = {
        "contact_area_m2": one.area_m2,
        "ridge_area_m2": one.ridge_area_m2,
        "centre_x_m": seen.centre_m[0] if seen else float("nan"),
        "centre_y_m": seen.centre_m[1] if seen else float("nan"),
        "long_axis_m": seen.axes_m[0] if seen else float("nan"),
        "short_axis_m": seen.axes_m[1] if seen else float("nan"),
        "angle_rad": seen.angle_rad if seen else float("nan"),
        "blur_m": seen.blur_m if seen else float("nan"),
    }
    row |= {name: f"{v:.6g}" if isfinite(v) else "" for name, v in values.items()}
    return row | {"bad": one.bad, "doubts": "; ".join(said)}


def _draw(film: Film, watched: Watched, mm: float, paths: tuple[Path, Path]) -> None:
    # matplotlib is slow to import
    from haptic_driver.lab.pictures.contact import draw_areas, draw_outlines, drawn_frames  # noqa: PLC0415

    found = watched.found
    chosen = set(drawn_frames(found))
    shown: list[tuple[int, Array, FrameSeen]] = [
        (i, frame, found[i]) for i, frame in enumerate(film.frames()) if i in chosen
    ]
    title = f"contact is {watched.contact}, {mm:.4g} mm per pixel"
    draw_outlines(shown, mm, paths[0], title)
    draw_areas(found, paths[1])


def _words(told: Summary) -> str:
    return ", ".join(f"{count} {why}" for why, count in told.bad.items()) or "none is bad"


def _show(told: Summary, out: Path, said: Sequence[str]) -> None:
    stdout.print(f"{out}: {told.counted} of {told.frames} frames count; {_words(told)}")
    for words in said:
        stdout.print(f"  {words}")
    if told.counted:
        spread = f" ± {1e6 * told.area_std_m2:.2f}" if isfinite(told.area_std_m2) else ""
        stdout.print(f"apparent contact area {1e6 * told.area_m2:.2f}{spread} mm² per frame")
    if isfinite(told.ridge_area_m2):
        stdout.print(f"ridges inside {1e6 * told.ridge_area_m2:.2f} mm²")
