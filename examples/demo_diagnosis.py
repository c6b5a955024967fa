"""The diagnosis closed: measure a rig with a hidden effect, name it, rebuild the surface, render again.

`python examples/demo_diagnosis.py --out DIR` runs the commands a lab would run and draws friction before and after.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

from haptic_driver.cli.main import main as haptic

RIG, PLAN, MODEL = "hidden_humidity", "full", "reference"


def command(*arguments: str) -> dict[str, Any]:
    """Run one `haptic` command with --json and return its object; shows the command."""
    print(f"$ haptic {' '.join(arguments)}")
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        status = haptic([*arguments, "--json"])
    if status:
        sys.exit(status)
    found: dict[str, Any] = json.loads(said.getvalue())
    return found


def run(out: Path) -> dict[str, Any]:
    """All steps; returns friction error and share within 5 % before and after, and the verdict."""
    out.mkdir(parents=True, exist_ok=True)
    data, diagnosis = str(out / "data.csv"), str(out / "diagnosis")
    measured = command("measure", "--rig", RIG, "--plan", PLAN, "--out", data, "--force")
    found = command("diagnose", data, "--model", MODEL, "--out", diagnosis)
    surfaces = {"before": str(out / "before.h5"), "after": str(out / "after.h5")}
    models = {"before": MODEL, "after": found["model"]}
    rendered = {}
    for when, surface in surfaces.items():
        command("surface", "build", "--model", models[when], "--rig", RIG, "--out", surface)
        rendered[when] = command("demo", "--rig", RIG, "--surface", surface, "--out", str(out / when))
    keys = ("cof_error_rms", "share_within_5_percent", "max_voltage_v", "pictures")
    return {
        "rows": measured["rows"],
        "verdict": found["verdict"],
        "effects": [effect["name"] for effect in found["effects"]],
        "not_told_apart": [name for effect in found["effects"] for name in effect["indistinguishable_from"]],
        "held_out_chi2_per_point": found["fit"]["held_out_chi2_per_point"],
        "gap_closed": found["fit"]["gap_closed"],
        **{when: {key: rendered[when][key] for key in keys} for when in surfaces},
    }


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/demo-diagnosis"))
    out = parser.parse_args().out
    found = run(out)
    alike = f", not told from {', '.join(found['not_told_apart'])}" if found["not_told_apart"] else ""
    print(f"\nverdict {found['verdict']}: {', '.join(found['effects']) or 'no name'}{alike}")
    held = found["held_out_chi2_per_point"]
    print(f"held-out error per point {held['before']:.2f} -> {held['after']:.2f} (1 is noise)")
    for when in ("before", "after"):
        it = found[when]
        share = it["share_within_5_percent"]
        print(
            f"{when:>6}: friction error {it['cof_error_rms']:.4f} rms, {100 * share:.0f} % of sliding time within 5 %, "
            f"up to {it['max_voltage_v']:.0f} V, {it['pictures'][0]}"
        )
    print(f"report: {out / 'diagnosis' / 'report.html'}")


if __name__ == "__main__":
    main()
