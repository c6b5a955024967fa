"""The paper's experiment, whole, on a simulated rig whose finger has what the model lacks.

`python demos/demo_experiment.py --out DIR` holds the load, measures nine trials a frequency,
draws figure 3, names what is missing, and renders friction by the model as given and as found.
Everything up to there is what a person would type.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from pathlib import Path

import numpy as np
from demo_diagnosis import draw_before_and_after, rendered

from haptic_driver.cli.main import main as haptic
from haptic_driver.lab.contact.film import grey
from haptic_driver.lab.contact.judge import watch
from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.lab.pictures.contact import draw_outlines, drawn_frames
from haptic_driver.lookup.models import load_model
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.parts.cameras import CameraSection
from haptic_driver.simulation.slide import SlideRecord, score
from model.touch_model import TouchModel

RIG, MODEL, PLAN = "simulated-paper", "reference", "paper"
# What the finger has and the model has not: the ground strap hangs on by a few nanofarads only.
HIDDEN, VALUES = "floating_body", {"body_capacitance_f": 3e-9}
# Ridges within the reach of a finger that has lost its ground strap.
TEXTURE = 'kind = "grating"\nmean_cof = 0.60\namplitude_cof = 0.04\nperiod_mm = 10.0\n'


def demonstrate(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    data, diagnosis, hide = out / "data.csv", out / "diagnosis", out / "hide.toml"
    told = "\n".join(f"{name} = {value!r}" for name, value in VALUES.items())
    hide.write_text(f"[{HIDDEN}]\n{told}\n", encoding="utf-8")
    typed("load", "hold", "0.5", "--rig", RIG, "--seconds", "3")
    how = ("--rig", RIG, "--plan", PLAN, "--hide", hide, "--out", data, "--force")
    typed("measure", *how)
    show_contact(data, out)
    typed("diagnose", data, "--model", MODEL, "--out", diagnosis)
    typed("figure", data, "--model", MODEL, "--diagnosis", diagnosis, "--out", out)
    show_friction(diagnosis, out)


def typed(*words: object) -> None:
    """Run a command of `haptic` as it would be typed, and say which."""
    line = [str(word) for word in words]
    print(f"\n$ haptic {' '.join(line)}", flush=True)
    began_s = time.monotonic()
    if status := haptic(line):
        sys.exit(status)
    print(f"  ({time.monotonic() - began_s:.0f} s)", flush=True)


def show_contact(data: Path, out: Path) -> None:
    """What the camera saw: areas by frequency, and the outline on frames of one more touch."""
    with data.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    areas: dict[float, list[float]] = {}
    for row in rows:
        if row["contact_area_m2"]:
            driven = float(row["voltage_v"]) > 0.0
            f = float(row["frequency_hz"]) if driven else 0.0
            areas.setdefault(f, []).append(1e6 * float(row["contact_area_m2"]))
    print("\ncontact area seen by the camera, mm², mean ± standard deviation of a trial:")
    for f in sorted(areas):
        name = f"{f:g} Hz" if f else "no voltage"
        print(f"  {name:>10}: {np.mean(areas[f]):6.1f} ± {np.std(areas[f], ddof=1):.1f}")
    draw_touch(hidden_rig(), out / "contact-outlines.png")
    draw_contact_areas(areas, out / "contact-areas.png")


def draw_touch(config: RigConfig, path: Path) -> None:
    """Frames of a touch under 0.5 N, with the outline that is found on them."""
    experiment = prepare(config, TouchModel(load_model(MODEL)), load_plan(PLAN))
    assert isinstance(config.camera, CameraSection)
    with SimulatedBench(config, experiment.model, seed=experiment.seed) as bench:
        bench.begin_session(1, 0.0)
        bench.begin_row(0, experiment.rows[0])
        bench.step(0.1, 0.5, 0.02)
        assert bench.camera is not None
        bench.camera.start()
        bench.step(config.camera.frames * config.camera.interval_s, 0.5, 0.02)
        frames = bench.camera.frames()
    pictures = grey([frame.image for frame in frames])
    time_s = np.array([frame.time_s for frame in frames])
    scale_m = config.camera.scale_m_per_pixel
    found, contact, _ = watch(lambda: pictures, time_s, scale_m)
    shown = [(i, pictures[i], found[i]) for i in drawn_frames(found)[:3]]
    draw_outlines(shown, 1e3 * scale_m, path, f"contact is {contact}")


def draw_contact_areas(areas: dict[float, list[float]], path: Path) -> None:
    figure, axes = pyplot().subplots(figsize=(6.4, 3.6), layout="constrained")
    with saved(figure, path, 130):
        names = [f"{f:g} Hz" if f else "no voltage" for f in sorted(areas)]
        axes.boxplot([areas[f] for f in sorted(areas)], tick_labels=names)
        axes.set(ylabel="apparent contact area, mm²", title="seen by the camera (simulated rig)")
        axes.grid(alpha=0.25)


def show_friction(diagnosis: Path, out: Path) -> None:
    """The same texture by the surface of the model as given and as found."""
    report = json.loads((diagnosis / "report.json").read_text(encoding="utf-8"))
    names = ", ".join(effect["name"].replace("_", " ") for effect in report["effects"])
    print(f"\nhidden was {HIDDEN}; the diagnosis says {report['verdict']}: {names or 'nothing'}")
    config, texture = hidden_rig(), out / "ridges.toml"
    texture.write_text(TEXTURE, encoding="utf-8")
    found = str(diagnosis / "model.toml")
    before, after = (rendered(model, config, str(texture)) for model in (MODEL, found))
    print("friction on target, asked against got, on the same finger:")
    for when, record in (("as given", before), ("as found", after)):
        print(f"  model {when:>8}: {asked_and_got(record)}")
    titles = {"model as given": before, f"with {names or 'the fit'}": after}
    draw_before_and_after(titles, out / "friction-on-target.png")
    for path in sorted(out.glob("*.png")):
        print(path)


def asked_and_got(record: SlideRecord) -> str:
    """Means over the slide, the rms error, and how much of it was on target and in reach."""
    touching = np.concatenate([np.arange(s.start, s.stop) for s in record.strokes])
    asked, got = record.target_cof[touching], record.measured_cof[touching]
    found = score(record).fidelity
    return (
        f"asked {np.nanmean(asked):.3f}, got {np.nanmean(got):.3f} on average;"
        f" error {found.cof_error_rms or 0.0:.4f} rms,"
        f" {found.share_within_5_percent or 0.0:.0%} of the time within 5 %,"
        f" {found.reachable_share or 0.0:.0%} within reach of that model"
    )


def hidden_rig() -> RigConfig:
    config = load_rig(RIG)
    simulation = config.simulation.model_copy(update={"hide": {HIDDEN: VALUES}})
    return config.model_copy(update={"simulation": simulation})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/demo-experiment"))
    began_s = time.monotonic()
    demonstrate(parser.parse_args().out)
    print(f"{time.monotonic() - began_s:.0f} s in all")
