"""The diagnosis closed: investigate a rig with a hidden effect, rebuild the surface with its name,
render again.

`python demos/demo_diagnosis.py --out DIR` investigates as a lab would and draws friction before
and after.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.lab.measuring.investigate import Budget, Investigation, Subject, investigate
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.pictures.friction_pictures import ACHIEVED, DPI, TARGET
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.slide import synthetic_slide
from haptic_driver.signals import WITHIN
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.simulation.slide import SlideRecord, score
from haptic_driver.textures.library import load_texture
from model.touch_model import TouchModel

RIG, MODEL, PLAN, TEXTURE = "hidden_humidity", "reference", "witnesses", "grating"


@dataclass(frozen=True)
class Demonstration:
    """What the investigation found, what was rendered by the old model and by the new one, and the
    picture of both.
    """

    found: Investigation
    before: SlideRecord
    after: SlideRecord
    picture: Path


def demonstrate(out: Path) -> Demonstration:
    subject = Subject(load_rig(RIG), load_model(MODEL), load_plan(PLAN))
    found = investigate(subject, out / "investigation", Budget(), print)
    before, after = (rendered(m, load_rig(RIG)) for m in (MODEL, found.diagnosis["model"]))
    names = ", ".join(effect["name"].replace("_", " ") for effect in found.diagnosis["effects"])
    picture = out / "before-and-after.png"
    draw_before_and_after({"the model as given": before, f"with {names} added": after}, picture)
    return Demonstration(found, before, after, picture)


def rendered(model: str, config: RigConfig, name: str = TEXTURE) -> SlideRecord:
    """The rig's finger sliding over the texture, driven by the surface of a model; feedback would
    hide what is off.
    """
    description, texture = load_model(model), load_texture(name, texture_dirs())
    settings = render_settings(
        config, build_surface(description, config.operating_limits()), feedback=False
    )
    finger = load_model(config.simulation.model or MODEL)
    with SimulatedRig(config, TouchModel(finger)) as rig:
        return render_slide(synthetic_slide(), texture, settings, rig)


def draw_before_and_after(records: Mapping[str, SlideRecord], path: Path) -> None:
    """Target and achieved friction over position, the first stroke of each record, one panel
    each.
    """
    figure, panels = pyplot().subplots(
        1,
        len(records),
        figsize=(10, 4.2),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    with saved(figure, path, DPI):
        for axes, (title, record) in zip(panels[0], records.items(), strict=True):
            for stroke in record.strokes[:1]:
                x, target = 1e3 * record.slide.position_m[stroke], record.target_cof[stroke]
                band = (1 - WITHIN) * target, (1 + WITHIN) * target
                axes.fill_between(x, *band, color=TARGET, alpha=0.15, lw=0, label="target ± 5 %")
                axes.plot(x, target, color=TARGET, lw=1.5, label="target")
                axes.plot(x, record.measured_cof[stroke], color=ACHIEVED, lw=1.0, label="achieved")
            share = score(record).fidelity.share_within_5_percent or 0.0
            axes.set(title=f"{title}: {share:.0%} within 5 %", xlabel="position, mm")
            axes.grid(alpha=0.25)
        panels[0][0].set(ylabel="coefficient of friction")
        panels[0][0].legend(frameon=False)
        figure.suptitle("friction under a sliding finger (simulated rig)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/demo-diagnosis"))
    shown = demonstrate(parser.parse_args().out)
    found = shown.found
    for number, told in enumerate(found.history, start=1):
        after = {proposal["first"]["intervention"] for proposal in told["proposals"]} - {"none"}
        then = f"measured again after: {', '.join(sorted(after))}" if after else "measured more"
        print(f"round {number}: {told['verdict']}, {' or '.join(told['suspects'])}; then {then}")
    names = ", ".join(effect["name"] for effect in found.diagnosis["effects"])
    print(
        f"{found.outcome}: {names}, {found.rows} rows, {found.measured_s / 60.0:.0f} min of"
        " measuring"
    )
    for when, record in (("before", shown.before), ("after", shown.after)):
        it = score(record)
        error, share = it.fidelity.cof_error_rms or 0.0, it.fidelity.share_within_5_percent or 0.0
        print(
            f"{when:>6}: friction error {error:.4f} rms, {share:.0%} of sliding time within 5 %, "
            f"up to {it.max_voltage_v:.0f} V"
        )
    print(
        f"picture: {shown.picture}; report:"
        f" {Path(found.diagnosis['model']).with_name('report.html')}"
    )


if __name__ == "__main__":
    main()
