"""What a diagnosis says, as JSON can hold it; and the folder with everything that a run leaves behind."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from model.description import ModelDescription
from model.diagnosis.fit import Fit
from model.diagnosis.model_file import (
    NAMED_VERDICTS,
    fitted_effects,
    fitted_nuisances,
    program,
    verdict_probability,
    write_model,
)
from model.diagnosis.naming import NONE, PRIOR_NONE, PRIOR_UNKNOWN, UNKNOWN, Candidate
from model.diagnosis.next_experiment import next_experiments
from model.diagnosis.page import write_html
from model.diagnosis.pictures import leaders, pictures
from model.diagnosis.proof import prove
from model.diagnosis.space import NUISANCES
from model.diagnosis.where import Disagreement, Region
from model.diagnosis.workflow import Diagnosis
from model.effects import BY_NAME, CATALOGUE
from model.parameters import Parameter
from model.support.arrays import Array

Record = dict[str, Any]
CANDIDATES = 8  # listed with their fits


def report(diagnosis: Diagnosis, description: ModelDescription, model_path: str) -> Record:
    """The whole report as JSON can hold it: finite numbers, null where there is none.

    Keys `verdict` to `seed` are the public contract of `haptic diagnose --json`; the rest is for the curious.
    """
    fit, proof = _fit(diagnosis), diagnosis.proof
    content = {
        "verdict": diagnosis.name,
        "adequate": diagnosis.verdict is not None and diagnosis.verdict.adequate,
        "effects": _effects(diagnosis),
        "alternatives": _alternatives(diagnosis),
        "where": [] if diagnosis.before is None else [_region(r) for r in diagnosis.before.regions],
        "fit": {
            "chi2_per_point": fit,
            "held_out_chi2_per_point": {
                "before": None if proof is None else _mean(proof.before),
                "after": None if proof is None else _mean(proof.after),
            },
            "gap_closed": None if proof is None else proof.gap_closed,
            "gap_closed_interval": [None, None] if proof is None else list(proof.interval),
        },
        "model": model_path,
        "seed": diagnosis.seed,
        "probability": verdict_probability(diagnosis),
        "reasons": list(diagnosis.verdict.reasons if diagnosis.verdict else diagnosis.warnings),
        "warnings": list(diagnosis.warnings if diagnosis.verdict else ()),
        "data": _data(diagnosis),
        "tests": {"before": _tests(diagnosis.before), "after": _tests(diagnosis.after)},
        "parameters": _parameters(diagnosis, description),
        "candidates": _candidates(diagnosis),
        "held_out": _held_out(diagnosis, description),
        "not_tested": _not_tested(diagnosis, description),
        "next_experiments": next_experiments(diagnosis, description),
        "checks": {effect: BY_NAME[effect].check for effect in _suspects(diagnosis)},
        "parent_model": {"name": description.name, "hash": description.content_hash},
        "versions": {"program": program(), "numpy": np.__version__, "scipy": scipy.__version__},
    }
    finite: Record = _finite(content)
    return finite


def _finite(value: Any) -> Any:
    """The same with NaN and infinities as None and numpy's numbers as Python's."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _fit(diagnosis: Diagnosis) -> Record:
    if diagnosis.verdict is None or diagnosis.weighed is None:
        return {"before": None, "after": None}
    n = diagnosis.data.count
    return {"before": diagnosis.weighed.base.fit.chi2 / n, "after": diagnosis.verdict.chosen.fit.chi2 / n}


def _effects(diagnosis: Diagnosis) -> list[Record]:
    verdict = diagnosis.verdict
    if verdict is None or diagnosis.name not in NAMED_VERDICTS:
        return []
    return [
        {
            "name": name,
            "probability": verdict.probabilities[name],
            "parameters": {key: _number(p) for key, p in values.items()},
            "indistinguishable_from": list(verdict.group.get(name, [])),
        }
        for name, values in fitted_effects(verdict.chosen.fit).items()
    ]


def _number(parameter: Parameter) -> Record:
    return {"value": parameter.value, "std": parameter.std, "unit": parameter.unit}


def _alternatives(diagnosis: Diagnosis) -> list[Record]:
    """Every candidate, none and unknown; their priors where nothing could be tested."""
    if diagnosis.verdict is None:
        each = (1.0 - PRIOR_NONE - PRIOR_UNKNOWN) / len(CATALOGUE)
        known = {NONE: PRIOR_NONE, UNKNOWN: PRIOR_UNKNOWN} | {kind.name: each for kind in CATALOGUE}
    else:
        known = diagnosis.verdict.probabilities
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
        "mean_relative_error": math.expm1(region.mean_log_error),
    }


def _data(diagnosis: Diagnosis) -> Record:
    data, noise = diagnosis.data, diagnosis.noise
    return {
        "rows": data.count,
        "rows_with_voltage": int(data.driven.sum()),
        "sessions": len(np.unique(data.session)),
        "columns": sorted(data.columns),
        "noise_source": None if noise is None else noise.source,
        "noise_relative_std": None if noise is None else float(np.median(noise.relative_std)),
        "replicate_degrees_of_freedom": None if noise is None else noise.replicate_degrees,
        "hash": data.content_hash,
    }


def _tests(scan: Disagreement | None) -> Record | None:
    if scan is None:
        return None
    return {
        "region_p_value": scan.regions[0].p_value if scan.regions else None,
        "lack_of_fit_p_value": scan.lack_of_fit_p,
        "order_p_value": scan.order_p,
        "order_correlation": scan.order_correlation,
    }


def _parameters(diagnosis: Diagnosis, description: ModelDescription) -> list[Record]:
    """The finger's parameters: in the input model, fitted without and with the effects; drift in prior sd."""
    if diagnosis.verdict is None or diagnosis.weighed is None:
        return []
    base, chosen = diagnosis.weighed.base.fit, diagnosis.verdict.chosen.fit
    alone, beside = fitted_nuisances(description, base), fitted_nuisances(description, chosen)
    return [
        {
            "name": n.name,
            "unit": alone[n.name].unit,
            "model": description.parameters[n.name].value,
            "before": _number(alone[n.name]) | {"drift": n.in_std(float(base.vector[i]))},
            "after": _number(beside[n.name]) | {"drift": n.in_std(float(chosen.vector[i]))},
        }
        for i, n in enumerate(NUISANCES)
    ]


def _candidates(diagnosis: Diagnosis) -> list[Record]:
    """The base model, the chosen one and the best of the rest, with what their fits say."""
    if diagnosis.verdict is None or diagnosis.weighed is None:
        return []
    base = diagnosis.weighed.base
    probabilities = diagnosis.verdict.probabilities
    return [
        {
            "name": c.name,
            "probability": probabilities.get(c.name),
            "log_evidence_gain": c.alone.log_evidence - base.alone.log_evidence,
            "unknown_beside_it": c.beside_discrepancy.log_evidence - c.alone.log_evidence,
            "chi2_per_point": c.fit.chi2 / diagnosis.data.count,
            "parameters": _shown(c.fit),
        }
        for c in (base, *leaders(diagnosis, CANDIDATES))
    ]


def _shown(fit: Fit) -> Record:
    return {effect: {key: _number(p) for key, p in values.items()} for effect, values in fitted_effects(fit).items()}


def _held_out(diagnosis: Diagnosis, description: ModelDescription) -> Record | None:
    """The proof fold by fold, and what the best rival reaches in the same folds without being chosen."""
    proof, verdict = diagnosis.proof, diagnosis.verdict
    if proof is None or verdict is None or not proof.before.size:
        return None
    rival = _best_rival(diagnosis)
    return {
        "by": proof.by,
        "folds": list(proof.folds),
        "before": proof.before,
        "after": proof.after,
        "chosen_again": proof.inclusion,
        "best_rival": None if rival is None else {"name": rival.name} | _rival(diagnosis, description, rival),
    }


def _best_rival(diagnosis: Diagnosis) -> Candidate | None:
    """The most probable effect that is neither named nor counted among what is not told apart."""
    verdict = diagnosis.verdict
    if verdict is None or diagnosis.weighed is None or not verdict.chosen.kinds:
        return None
    taken = {kind.name for kind in verdict.chosen.kinds} | {n for names in verdict.group.values() for n in names}
    others = [c for c in diagnosis.weighed.singles if c.name not in taken]
    return max(others, key=lambda c: c.alone.log_evidence, default=None)


def _rival(diagnosis: Diagnosis, description: ModelDescription, rival: Candidate) -> Record:
    """The rival through the same folds, measured in the noise that the chosen model leaves."""
    if diagnosis.noise is None or diagnosis.verdict is None:
        return {}
    scale = diagnosis.verdict.chosen.beside_discrepancy.scale
    tried = prove(description, diagnosis.data, diagnosis.noise, rival, [], scale, diagnosis.seed, lambda _: None)
    return {"after": tried.after, "gap_closed": tried.gap_closed, "gap_closed_interval": list(tried.interval)}


def _not_tested(diagnosis: Diagnosis, description: ModelDescription) -> list[Record]:
    if diagnosis.weighed is None:
        return []
    on = {effect.name for effect in description.effects}
    return [
        {
            "name": name,
            "why": "already in the model" if name in on else f"needs {', '.join(BY_NAME[name].needs)}, varied",
        }
        for name in diagnosis.weighed.untestable
    ]


def _mean(values: Array) -> float:
    return float(np.mean(values)) if values.size else float("nan")


def _suspects(diagnosis: Diagnosis) -> list[str]:
    """Named effects and what is not told apart from them."""
    verdict = diagnosis.verdict
    if verdict is None or diagnosis.name not in NAMED_VERDICTS:
        return []
    names = [n for kind in verdict.chosen.kinds for n in (kind.name, *verdict.group.get(kind.name, []))]
    return list(dict.fromkeys(names))


def write_report(diagnosis: Diagnosis, description: ModelDescription, out_dir: Path, source_name: str) -> Record:
    """Write report.json, report.html, model.toml and pictures/ into `out_dir`; returns the report."""
    out_dir.mkdir(parents=True, exist_ok=True)
    model_path = out_dir / "model.toml"
    content = report(diagnosis, description, str(model_path))
    content["data"]["file"] = Path(source_name).name
    write_model(diagnosis, description, model_path, source_name)
    drawn = pictures(diagnosis)
    folder = out_dir / "pictures"
    folder.mkdir(exist_ok=True)
    for name, png in drawn.items():
        (folder / f"{name}.png").write_bytes(png)
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    (out_dir / "report.json").write_text(text + "\n", encoding="utf-8")
    write_html(content, drawn, out_dir / "report.html")
    return content
