"""What a surface costs: with nothing cached, with each effect, with every two of them, and compiled for the first time.

CPU seconds of a process of its own that is held to one core; the least of several, since other work on the machine only
ever adds to them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from benchmarks.claim import Claim

PLAIN_S, WITH_EFFECTS_S, CONDITIONS_S, COMPILING_S = 0.3, 0.5, 5e-3, 8.0

FIRST = """
import json, os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from haptic_driver.surface.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.surface.build import build_surface
from model.touch_model import TouchModel
base, limits = load_model("reference"), load_rig("simulated").operating_limits()
TouchModel(base).table
start = time.process_time()
build_surface(base, limits)
print(json.dumps(time.process_time() - start))
"""

PROGRAM = """
import itertools, json, os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from dataclasses import replace
import numpy as np
from haptic_driver.surface.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.surface.build import SurfaceAxes, build_surface
from haptic_driver.surface.file import ready_for_lookup
from model.conditions import Conditions
from model.contact.gap_table import build_table
from model.effects import CATALOGUE
from model.parameters import Parameter
from model.touch_model import TouchModel

base, limits = load_model("reference"), load_rig("simulated").operating_limits()
STRENGTHS = 1.0, 0.0, -1.0, -2.0  # deviations of the prior; below 0 most effects are stronger

def least(function, repeats):
    times = []
    for _ in range(repeats):
        start = time.process_time(); function(); times.append(time.process_time() - start)
    return min(times)

def on(*deviations):
    effects = {e.name: {p.name: Parameter(p.from_normal(x), p.unit, "") for p in e.parameters()} for e, x in deviations}
    return replace(base, effect_parameters=effects)

def built(model, repeats):
    return least(lambda: build_surface(model, limits), repeats)

def weak(effect):  # where it leaves a force
    return 2.0 if np.isinf(effect.parameters()[0].off) else -2.0

rng = np.random.default_rng(7)
f, v, n = np.exp(rng.uniform(0.0, np.log(1e6), 1000)), rng.uniform(0.0, 150.0, 1000), rng.uniform(0.1, 2.0, 1000)
conditions = Conditions(f, v, n, speed_m_s=rng.uniform(1e-3, 0.2, 1000), time_s=rng.uniform(0.0, 600.0, 1000))
all_weak = on(*((e, weak(e)) for e in CATALOGUE))
touches = {e.name: TouchModel(on((e, 0.5))) for e in CATALOGUE} | {"all twenty": TouchModel(all_weak)}
two = itertools.combinations(CATALOGUE, 2)
plain = TouchModel(base)
plain.predict(conditions)
surface = build_surface(base, limits)
force_n = build_surface(all_weak, limits).electrostatic_force_n
print(json.dumps({
    "table": least(lambda: build_table(plain.table.shape), 1),
    "plain": built(base, 5),
    "ready": least(lambda: ready_for_lookup(surface, limits), 5),
    "interval": least(lambda: build_surface(base, limits, with_interval=True), 2),
    "effects": {e.name: max(built(on((e, x)), 2) for x in STRENGTHS) for e in CATALOGUE},
    "pairs": {f"{a.name}, {b.name}": built(on((a, -1.0), (b, -1.0)), 2) for a, b in two},
    "all": built(all_weak, 3),
    "attraction": float(np.nanmax(force_n / surface.normal_force_n)),
    "predict": least(lambda: plain.predict(conditions), 15),
    "predict with": {name: least(lambda: touch.predict(conditions), 15) for name, touch in touches.items()},
}))
"""


def run() -> Iterator[Claim]:
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "HAPTIC_CACHE_DIR": cache}
        cold, warm = (_told(FIRST, environment) for _ in range(2))
        told = _told(PROGRAM, environment)
    said = "CPU of a surface 200 x 128 x 5"
    yield Claim(said, _ms(told["plain"]), "300 ms at most", told["plain"] <= PLAIN_S)
    for what, times in (("one effect", told["effects"]), ("two effects", told["pairs"])):
        name, slowest = max(times.items(), key=lambda item: item[1])
        yield Claim(
            f"{said} with {what}, the slowest of {len(times)} ({name})", _ms(slowest), "500 ms at most",
            slowest <= WITH_EFFECTS_S,
        )  # fmt: skip
        yield Claim(f"half of the surfaces with {what} take at most", _ms(sorted(times.values())[len(times) // 2]))
    yield Claim(
        f"{said} with all twenty (attraction up to {told['attraction']:.1f} of the load)", _ms(told["all"]),
        "500 ms at most", told["all"] <= WITH_EFFECTS_S,
    )  # fmt: skip
    predict = told["predict"]
    yield Claim("CPU of 1000 arbitrary conditions", _ms(predict), "5 ms at most", predict <= CONDITIONS_S)
    name, slowest = max(told["predict with"].items(), key=lambda item: item[1])
    yield Claim(f"the same, the slowest effect ({name})", _ms(slowest), "5 ms at most", slowest <= CONDITIONS_S)
    compiling = cold - warm
    yield Claim("CPU of compiling, once", f"{compiling:.1f} s", "8 s at most", compiling <= COMPILING_S)
    yield Claim("CPU of a gap table, once per roughness shape", _ms(told["table"]))
    yield Claim("CPU of a surface with its interval", _ms(told["interval"]))
    yield Claim("CPU of making it ready for the controller", _ms(told["ready"]))


def _told(program: str, environment: dict[str, str]) -> dict[str, object]:
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if seconds < 0.01 else f"{1e3 * seconds:.0f} ms"
