"""Recordings as measured data: their windows are rows as `haptic measure` writes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input, require_free, write_rows
from haptic_driver.live.window import NONE_YET, SHORTEST_S, row, windows
from haptic_driver.recording.read import read_run, run_names
from model.diagnosis.data import Measurements, read_measurements, together
from model.support.tables import NO_NAMES, Named

ENDINGS = (".h5", ".hdf5")


def read_data(
    paths: Sequence[Path],
    rows: Path | None = None,
    leave_out_bad: bool = False,
    named: Mapping[str, Named] = NO_NAMES,
) -> Measurements:
    """Files of measured data (CSV) and recordings (HDF5), by their endings, as one data set.

    What the recordings were cut into is kept in the file `rows`. BadInputError for what cannot be
    used; with `leave_out_bad` rows of tables that cannot be are left out, see `read_measurements`.
    `named`: what the first table calls its columns, and the others where they have them.
    """
    recordings = [path for path in paths if path.suffix.lower() in ENDINGS]
    tables = [path for path in paths if path not in recordings]
    if rows is not None and not recordings:
        said = "--rows is for what a recording was cut into, and no recording is given"
        raise BadInputError("usage", said, "Leave it out, or give a file that haptic record wrote")
    if rows is not None:
        require_free(rows, option="--rows")
    with TemporaryDirectory() as folder, bad_input("bad_data"):
        parts = list[tuple[str, Measurements]]()
        if recordings:
            cut = rows or Path(folder) / "rows.csv"
            write_recorded(recordings, cut)
            parts.append((", ".join(map(str, recordings)), read_measurements(cut)))
        for path in tables:
            parts.append((str(path), read_measurements(path, leave_out_bad, named)))
            named = {ours: one._replace(needed=False) for ours, one in named.items()}
        return together(parts)


def write_recorded(recordings: Sequence[Path], out: Path) -> int:
    """Write the rows of recordings to a CSV with the columns of `haptic measure`; returns how many.

    BadInputError for what is no recording, and where nothing in one is steady.
    """
    texts: list[dict[str, str]] = []
    counted = NONE_YET
    for path in recordings:
        before = len(texts)
        for name in run_names(path):
            run = read_run(path, name)
            budget_s = run.attributes["latency_budget_s"]
            simulated = bool(run.attributes["simulated"])
            found, counted = windows(run.samples, budget_s, counted._replace(ended_s=-inf))
            texts += [row(each, run.samples["time_s"][0], simulated=simulated) for each in found]
        if len(texts) == before:
            said = (
                f"{path}: no {SHORTEST_S:g} s of sliding in it under a steady load, speed and"
                " voltage"
            )
            hint = "Record even strokes at one friction after another: haptic set"
            raise BadInputError("nothing_steady", said, hint)
    write_rows(out, texts)
    return len(texts)
