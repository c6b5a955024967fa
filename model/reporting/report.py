"""What a diagnosis says, as JSON can hold it; and the folder with everything that a run leaves
behind.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from haptic_driver.base.strict_json import finite
from model.description import ModelDescription
from model.diagnosis.changed import places
from model.diagnosis.data import Measurements
from model.diagnosis.priors import NONE, PRIOR_EFFECTS, PRIOR_NONE, PRIOR_UNKNOWN, UNKNOWN
from model.diagnosis.proof import prove
from model.diagnosis.where import ALARM, Disagreement, Region
from model.diagnosis.witness import FRICTION, WITNESSES
from model.diagnosis.workflow import Diagnosis, Findings
from model.effects import BY_NAME, CATALOGUE
from model.parameters import Parameter
from model.planning.next_experiment import next_experiments, out_of_sight
from model.reporting.learned_report import learned_record
from model.reporting.model_file import fitted_effects, fitted_nuisances, program, write_model
from model.reporting.page import write_html
from model.reporting.pictures import leaders, pictures
from model.support.arrays import Array

Record = dict[str, Any]
CANDIDATES = 8  # listed with their fits


def report(diagnosis: Diagnosis, description: ModelDescription, model_path: str) -> Record:
    """The whole report as JSON can hold it: finite numbers, null where there is none.

    Keys `verdict` to `seed` are the public contract of `haptic diagnose --json`; the rest is for
    the curious.
    """
    tested = (
        {} if diagnosis.findings is None else _tested(diagnosis, diagnosis.findings, description)
    )
    content = {
        "verdict": diagnosis.name,
        "adequate": False,
        "effects": [],
        "alternatives": _alternatives(diagnosis),
        "hypotheses": [],
        "where": [],
        "changed": {"rows": 0, "of": 0, "where": []},
        "left": [],
        "fit": {
            "chi2_per_point": {"before": None, "after": None},
            "held_out_chi2_per_point": {"before": None, "after": None},
            "gap_closed": None,
            "gap_closed_interval": [None, None],
        },
        "model": model_path,
        "seed": diagnosis.seed,
        "probability": None,
        "reasons": diagnosis.warnings,
        "looks_like": [],
        "warnings": [],
        "data": _data(diagnosis),
        "tests": {"before": None, "after": None},
        "parameters": [],
        "candidates": [],
        "learned": None,
        "held_out": None,
        "not_tested": [],
        "out_of_sight": [],
        "next_experiments": [],
        "checks": {},
        "parent_model": {"name": description.name, "hash": description.content_hash},
        "versions": {"program": program(), "numpy": np.__version__, "scipy": scipy.__version__},
    }
    strict: Record = finite(content | tested)
    return strict


def _tested(diagnosis: Diagnosis, found: Findings, description: ModelDescription) -> Record:
    """What a report says only where something was fitted."""
    verdict, base, proof, rows = (
        found.verdict,
        found.hypotheses.base,
        found.proof,
        diagnosis.data.count,
    )
    on = {effect.name for effect in description.effects}
    effects = fitted_effects(found.chosen.fit) if found.adds_effects else {}
    return {
        "adequate": verdict.adequate,
        "effects": [
            {
                "name": name,
                "probability": verdict.posterior.inclusion.get(name, verdict.probability),
                "parameters": {key: _number(p) for key, p in values.items()},
                "indistinguishable_from": verdict.group.get(name, []),
            }
            for name, values in effects.items()
        ],
        "hypotheses": [
            {"names": names, "probability": p} for names, p in verdict.posterior.hypotheses.items()
        ],
        "where": [_region(r) for r in found.before.regions],
        "changed": _changed(diagnosis.data, found),
        "left": [_region(r) for r in found.after.regions if r.p_value < ALARM],
        "fit": {
            "chi2_per_point": {
                "before": base.fit.chi2 / rows,
                "after": found.chosen.fit.chi2 / rows,
            },
            "held_out_chi2_per_point": {"before": _mean(proof.before), "after": _mean(proof.after)},
            "gap_closed": proof.gap_closed,
            "gap_closed_interval": proof.interval,
        },
        "probability": verdict.probability,
        "reasons": [verdict.reason],
        "looks_like": verdict.posterior.looks_like,
        "warnings": diagnosis.warnings,
        "tests": {"before": _tests(found.before), "after": _tests(found.after)},
        "parameters": _parameters(found, description),
        "candidates": _candidates(found, rows),
        "learned": None if found.learned is None else learned_record(found.learned),
        "held_out": _held_out(diagnosis, found, description),
        "not_tested": [
            {
                "name": n,
                "why": (
                    "already in the model"
                    if n in on
                    else f"needs {', '.join(BY_NAME[n].needs)}, varied"
                ),
            }
            for n in found.hypotheses.untestable
        ],
        "out_of_sight": out_of_sight(diagnosis),
        "next_experiments": next_experiments(diagnosis, description),
        "checks": {name: BY_NAME[name].check for name in verdict.suspects},
    }


def _number(parameter: Parameter) -> Record:
    return {"value": parameter.value, "std": parameter.std, "unit": parameter.unit}


def _alternatives(diagnosis: Diagnosis) -> list[Record]:
    """Every candidate, none and unknown; their priors where nothing could be tested."""
    if diagnosis.findings is None:
        each = PRIOR_EFFECTS / len(CATALOGUE)
        known = {NONE: PRIOR_NONE, UNKNOWN: PRIOR_UNKNOWN} | {kind.name: each for kind in CATALOGUE}
    else:
        known = diagnosis.findings.verdict.posterior.shares
    total = math.fsum(known.values())
    ranked = sorted(known.items(), key=lambda item: -item[1])
    return [{"name": name, "probability": value / total} for name, value in ranked]


def _region(region: Region) -> Record:
    one = len(region.axes) == 1
    return {
        "axis": region.axes[0] if one else list(region.axes),
        "low": region.low[0] if one else list(region.low),
        "high": region.high[0] if one else list(region.high),
        "p_value": region.p_value,
        "sign": region.sign,
        "rows": region.count,
        "z": region.z,
        "witness": WITNESSES[region.witness].column,
        "mean_relative_error": (
            None if WITNESSES[region.witness].is_phase else math.expm1(region.mean_error)
        ),
        "mean_error_rad": region.mean_error if WITNESSES[region.witness].is_phase else None,
    }


def _changed(data: Measurements, found: Findings) -> Record:
    """In how many rows friction is changed by what is missing, and where."""
    rows = found.changed[data.of(FRICTION)]
    return {"rows": int(np.sum(rows > 0.5)), "of": rows.size, "where": places(data, found.changed)}


def _data(diagnosis: Diagnosis) -> Record:
    data, noise = diagnosis.data, diagnosis.noise
    return {
        "rows": data.rows,
        "rows_with_voltage": (
            int(data.driven.sum())
            if data.row is None
            else int(np.unique(data.row[data.driven]).size)
        ),
        "rows_left_out": len(data.bad_rows),
        "witnesses": {WITNESSES[i].column: int(data.of(i).sum()) for i in data.witnesses},
        "sessions": len(np.unique(data.session)),
        "columns": sorted(data.columns),
        "read_as": list(data.read_as),
        "noise_source": None if noise is None else noise.source,
        "noise_relative_std": (
            None if noise is None else float(np.median(noise.own_std[data.of(data.witnesses[0])]))
        ),
        "noise_std": {} if noise is None else _noise_by_witness(data, noise.own_std),
        "replicate_degrees_of_freedom": None if noise is None else noise.replicate_degrees,
        "hash": data.content_hash,
    }


def _noise_by_witness(data: Measurements, own_std: Array) -> Record:
    """Median of one observation's own, relative or in rad, by witness."""
    return {WITNESSES[w].column: float(np.median(own_std[data.of(w)])) for w in data.witnesses}


def _tests(scan: Disagreement) -> Record:
    return {
        "region_p_value": scan.regions[0].p_value if scan.regions else None,
        "lack_of_fit_p_value": scan.lack_of_fit_p,
        "order_p_value": scan.order_p,
        "order_correlation": scan.order_correlation,
    }


def _parameters(found: Findings, description: ModelDescription) -> list[Record]:
    """The finger's parameters: in the input model, fitted without and with the effects; drift in
    prior sd.
    """
    free = found.problem.predictor.free
    fits = {"before": found.hypotheses.base.fit, "after": found.chosen.fit}
    fitted = {when: fitted_nuisances(description, fit, free) for when, fit in fits.items()}
    return [
        {
            "name": n.name,
            "unit": description.parameters[n.name].unit,
            "model": description.parameters[n.name].value,
        }
        | {
            w: _number(fitted[w][n.name]) | {"drift": n.in_std(float(fit.vector[i]))}
            for w, fit in fits.items()
        }
        for i, n in enumerate(free)
    ]


def _candidates(found: Findings, rows: int) -> list[Record]:
    """The base model, the chosen one and the best of the rest, with what their fits say."""
    base = found.hypotheses.base
    return [
        {
            "name": c.name,
            "probability": found.verdict.posterior.hypotheses.get(c.names),
            "log_evidence_gain": c.alone.log_evidence - base.alone.log_evidence,
            "unknown_beside_it": c.beside_discrepancy.log_evidence - c.alone.log_evidence,
            "chi2_per_point": c.fit.chi2 / rows,
            "parameters": {
                e: {k: _number(p) for k, p in v.items()} for e, v in fitted_effects(c.fit).items()
            },
        }
        for c in (base, *leaders(found, CANDIDATES))
    ]


def _held_out(
    diagnosis: Diagnosis, found: Findings, description: ModelDescription
) -> Record | None:
    """The proof fold by fold, and the score of the best alternative in the same folds without being
    chosen.
    """
    proof = found.proof
    if not proof.before.size:
        return None
    return {
        "by": proof.by,
        "folds": proof.folds,
        "before": proof.before,
        "after": proof.after,
        "chosen_again": proof.inclusion,
        "best_rival": _best_rival(diagnosis, found, description),
    }


def _best_rival(
    diagnosis: Diagnosis, found: Findings, description: ModelDescription
) -> Record | None:
    """The most probable effect that is not suspected, through the same folds in the noise that the
    chosen leaves.
    """
    others = [c for c in found.hypotheses.singles if c.name not in found.verdict.suspects]
    if not found.chosen.kinds or not others:
        return None
    alternative = max(others, key=lambda c: c.alone.log_evidence)
    noise, scale = found.problem.noise, found.chosen.beside_discrepancy.scale
    tried = prove(
        description, diagnosis.data, noise, alternative, [], scale, diagnosis.seed, lambda _: None
    )
    return {
        "name": alternative.name,
        "after": tried.after,
        "gap_closed": tried.gap_closed,
        "gap_closed_interval": tried.interval,
    }


def _mean(values: Array) -> float:
    return float(np.mean(values)) if values.size else float("nan")


def write_report(
    diagnosis: Diagnosis, description: ModelDescription, out_dir: Path, source_name: str
) -> Record:
    """Write report.json, report.html, model.toml and pictures/ into `out_dir`; returns the
    report.
    """
    out_dir.mkdir(parents=True, exist_ok=True)
    model_path = out_dir / "model.toml"
    content = report(diagnosis, description, str(model_path))
    content["data"]["file"] = Path(source_name).name
    write_model(diagnosis, description, model_path, source_name)
    drawn = pictures(diagnosis)
    folder = out_dir / "pictures"
    folder.mkdir(exist_ok=True)
    content["pictures"] = [str(folder / f"{name}.svg") for name in drawn]
    for path, svg in zip(content["pictures"], drawn.values(), strict=True):
        Path(path).write_bytes(svg)
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    # The name of a file may be no UTF-8; escaped, it is JSON all the same.
    (out_dir / "report.json").write_bytes(f"{text}\n".encode(errors="backslashreplace"))
    write_html(content, drawn, out_dir / "report.html")
    return content
