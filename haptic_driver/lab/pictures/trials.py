"""A raw trial with its windows, as its map says."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.signals import Array

LINE, BASELINE, WINDOW, VOLTAGE = "#3a3a3a", "#6a994e", "#1b6ca8", "#d1495b"
LABELS = {
    "lateral_force": "lateral force, N",
    "normal_force": "load, N",
    "voltage": "voltage, V",
    "electrode_voltage": "electrode, V",
    "position": "position, mm",
    "speed": "speed, mm/s",
}


def draw_trial(
    title: str,
    columns: Mapping[str, Array],
    voltage_s: Sequence[float],
    spans: Sequence[tuple[str, float, float]],
    path: Path,
    as_written: Collection[str] = (),
) -> None:
    """Columns [n] in SI over time, voltage as lines at on and off, each span as a named band.

    Those of `as_written` are in the file's numbers.
    """
    drawn = [name for name in LABELS if name in columns]
    figure, axes = pyplot().subplots(
        len(drawn),
        1,
        sharex=True,
        squeeze=False,
        figsize=(9.0, 1.2 + 1.7 * len(drawn)),
        layout="constrained",
    )
    with saved(figure, path):
        for axis, name in zip(axes[:, 0], drawn, strict=True):
            what, unit = LABELS[name].rsplit(", ", 1)
            scale = 1e3 if unit in ("mm", "mm/s") and name not in as_written else 1.0
            axis.plot(columns["time"], scale * columns[name], color=LINE, lw=0.6)
            axis.set_ylabel(f"{what}, {'as in the file' if name in as_written else unit}")
            for label, start_s, end_s in spans:
                color = BASELINE if label == "baseline" else WINDOW
                axis.axvspan(start_s, end_s, color=color, alpha=0.2, lw=0)
            for at_s in voltage_s:
                axis.axvline(at_s, color=VOLTAGE, lw=1.2, ls="--")
        top = axes[0, 0].get_xaxis_transform()
        for label, start_s, end_s in spans:
            middle_s = 0.5 * (start_s + end_s)
            axes[0, 0].text(middle_s, 1.02, label, transform=top, ha="center", fontsize=8)
        axes[0, 0].set_title(title, fontsize=9, pad=18)
        seconds = "as in the file" if "time" in as_written else "s"
        axes[-1, 0].set_xlabel(f"time, {seconds}")
