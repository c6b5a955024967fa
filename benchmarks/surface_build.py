"""What a surface costs: with nothing cached, with each effect, with every two of them, and compiled
for the first time.

CPU seconds of a process of its own that is held to one core; the least of several, since other work
on the machine only ever adds to them. They are claimed against as many cubic look-ups by scipy, on
the same core, as there are touches.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

from benchmarks.claim import Claim

# Times one look-up per touch: five steps of the closed loop look the gap table up, the current
# twice (it is complex), and the circuit around each of these costs as much as the look-up: 14.
PLAIN = 15.0
# An effect may add a second branch of the drive, or turns of V(p_e) to be found: twice as much.
WITH_EFFECTS = 30.0
# Times a small function, per kernel: kernels take their callees in, so the usual one is twice as
# long.
COMPILING = 2.0

FIRST = """
import json, os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.lookup.build import build_surface
from model.touch_model import TouchModel
base, limits = load_model("reference"), load_rig("simulated").operating_limits()
TouchModel(base).table
start = time.process_time()
build_surface(base, limits)
took_s = time.process_time() - start

import sys
import numba, numpy as np
modules = [module for name, module in sys.modules.items() if name.split(".")[0] == "model"]
kind = numba.core.dispatcher.Dispatcher
kernels = {id(x) for m in modules for x in vars(m).values() if isinstance(x, kind)}

@numba.njit(nogil=True, error_model="numpy")
def small(nodes, values, wanted):  # where values that grow reach what is wanted
    found = np.empty(wanted.size)
    for m in range(wanted.size):
        low, high = 0, nodes.size - 1
        while high - low > 1:
            middle = (low + high) // 2
            if values[middle] <= wanted[m]:
                low = middle
            else:
                high = middle
        share = (wanted[m] - values[low]) / (values[high] - values[low])
        found[m] = np.exp(nodes[low] + share * (nodes[high] - nodes[low]))
    return found

numba.njit(lambda x: x + 1.0)(1.0)  # what numba itself does at its first function
start = time.process_time()
small(np.arange(9.0), np.arange(9.0), np.arange(3.0))
print(json.dumps({"took": took_s, "small": time.process_time() - start, "kernels": len(kernels)}))
"""

PROGRAM = """
import itertools, json, os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from dataclasses import replace
import numpy as np
from benchmarks.reference import LookUps
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.lookup.file import ready_for_lookup
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
    effects = {
        effect.name: {p.name: Parameter(p.from_normal(x), p.unit, "") for p in effect.parameters()}
        for effect, x in deviations
    }
    return replace(base, effect_parameters=effects)

def built(model, repeats):
    return least(lambda: build_surface(model, limits), repeats)

def weak(effect):  # where it leaves a force
    return 2.0 if np.isinf(effect.parameters()[0].off) else -2.0

rng = np.random.default_rng(7)
conditions = Conditions(
    np.exp(rng.uniform(0.0, np.log(1e6), 1000)),
    rng.uniform(0.0, 150.0, 1000),
    rng.uniform(0.1, 2.0, 1000),
    speed_m_s=rng.uniform(1e-3, 0.2, 1000),
    time_s=rng.uniform(0.0, 600.0, 1000),
)
all_weak = on(*((e, weak(e)) for e in CATALOGUE))
touches = {e.name: TouchModel(on((e, 0.5))) for e in CATALOGUE}
touches["all of them"] = TouchModel(all_weak)
two = itertools.combinations(CATALOGUE, 2)
plain = TouchModel(base)
plain.predict(conditions)
surface = build_surface(base, limits)
force_n = build_surface(all_weak, limits).electrostatic_force_n
of_surface, of_conditions = LookUps(surface.cof.size), LookUps(conditions.voltage_v.size)
of_conditions()
print(json.dumps({
    "table": least(lambda: build_table(plain.table.shape), 1),
    "look_ups": least(of_surface, 5),
    "few_look_ups": least(of_conditions, 15),
    "plain": built(base, 5),
    "ready": least(lambda: ready_for_lookup(surface, limits), 5),
    "interval": least(lambda: build_surface(base, limits, with_interval=True), 2),
    "effects": {e.name: max(built(on((e, x)), 2) for x in STRENGTHS) for e in CATALOGUE},
    "pairs": {f"{a.name}, {b.name}": built(on((a, -1.0), (b, -1.0)), 2) for a, b in two},
    "all": built(all_weak, 3),
    "attraction": float(np.nanmax(force_n / surface.normal_force_n)),
    "predict": least(lambda: plain.predict(conditions), 15),
    "predict with": {
        name: least(lambda: touch.predict(conditions), 15) for name, touch in touches.items()
    },
}))
"""


def run() -> Iterator[Claim]:
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "HAPTIC_CACHE_DIR": cache}
        cold, warm = (_told(FIRST, environment) for _ in range(2))
        told = _told(PROGRAM, environment)
    one_s, few_s = told["look_ups"], told["few_look_ups"]
    said = "CPU of a surface 200 x 128 x 5"
    yield _against(said, told["plain"], one_s, PLAIN)
    for what, times in (("one effect", told["effects"]), ("two effects", told["pairs"])):
        name, slowest = max(times.items(), key=lambda item: item[1])
        described = f"{said} with {what}, the slowest of {len(times)} ({name})"
        yield _against(described, slowest, one_s, WITH_EFFECTS)
        yield Claim(
            f"half of the surfaces with {what} take at most",
            _ms(sorted(times.values())[len(times) // 2]),
        )
    described = f"{said} with all of them (attraction up to {told['attraction']:.1f} of the load)"
    yield _against(described, told["all"], one_s, WITH_EFFECTS)
    yield _against("CPU of 1000 arbitrary conditions", told["predict"], few_s, PLAIN)
    name, slowest = max(told["predict with"].items(), key=lambda item: item[1])
    yield _against(f"the same, the slowest effect ({name})", slowest, few_s, WITH_EFFECTS)
    compiling_s, most = cold["took"] - warm["took"], COMPILING * cold["kernels"]
    ratio = compiling_s / cold["small"]
    yield Claim(
        f"CPU of compiling {cold['kernels']} kernels, once, against one small function",
        f"{ratio:.0f} x ({compiling_s:.1f} s against {cold['small']:.2f} s)",
        f"at most {most:.0f} x",
        ratio <= most,
    )
    yield Claim("CPU of a gap table, once per roughness shape", _ms(told["table"]))
    yield Claim("CPU of a surface with its interval", _ms(told["interval"]))
    yield Claim("CPU of making it ready for the controller", _ms(told["ready"]))


def _against(what: str, found_s: float, look_ups_s: float, most: float) -> Claim:
    ratio = found_s / look_ups_s
    return Claim(
        f"{what}, against a cubic look-up per touch",
        f"{ratio:.1f} x ({_ms(found_s)} against {_ms(look_ups_s)})",
        f"at most {most:g} x",
        ratio <= most,
    )


def _told(program: str, environment: dict[str, str]) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if seconds < 0.01 else f"{1e3 * seconds:.0f} ms"
