"""One surface, one rig and a few oracles that the driver's tests share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from haptic_driver.cli.main import main
from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.lookup.file import FORCE_REFINEMENT, SurfaceFile, ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.render.safety import Worst, table_of, violation, worst_at
from haptic_driver.rig.config import load_rig
from model.touch_model import TouchModel
from tests.haptic_driver.commands import one_object

SEED = 20240607


@pytest.fixture
def shared():
    state = SharedState()
    yield state
    state.close()


@pytest.fixture
def rng():
    return np.random.default_rng(SEED)


@pytest.fixture(scope="session")
def rig_config():
    return load_rig("simulated")


@pytest.fixture(scope="session")
def limits(rig_config):
    return rig_config.operating_limits()


@pytest.fixture(scope="session")
def model_description():
    return load_model("reference")


@pytest.fixture(scope="session")
def touch(model_description):
    return TouchModel(model_description)


@pytest.fixture(scope="session")
def surface_file(model_description, limits):
    """The surface that the program builds when nobody says otherwise."""
    return build_surface(model_description, limits)


@pytest.fixture(scope="session")
def surface(surface_file, limits):
    return ready_for_lookup(surface_file, limits)


@pytest.fixture(scope="session")
def refusal(surface_file, limits):
    """Why the gate refuses a point, by its own table."""
    table = table_of(surface_file.worst_case(limits))

    def why(given, point):
        return violation(given, point, Worst(*worst_at(table, point.frequency_hz, point.voltage_v)))

    return why


@pytest.fixture(scope="session")
def surface_path(surface_file, tmp_path_factory):
    path = tmp_path_factory.mktemp("surface") / "surface.h5"
    surface_file.write(path)
    return path


@pytest.fixture(scope="session")
def small_file(model_description, limits):
    axes = SurfaceAxes(frequency_count=6, voltage_count=8, normal_force_count=4)
    return build_surface(model_description, limits, axes)


class Grid(NamedTuple):
    """The nodes of a surface made ready for look-up, worked out from the file it was made from."""

    frequency_hz: np.ndarray
    normal_force_n: np.ndarray
    voltage_v: np.ndarray


@pytest.fixture(scope="session")
def grid(surface_file, surface):
    force = surface_file.normal_force_n
    fine = np.geomspace(force[0], force[-1], (force.size - 1) * FORCE_REFINEMENT + 1)
    nodes = Grid(surface_file.frequency_hz, fine, surface_file.voltage_v)
    assert surface.cof.shape == tuple(x.size for x in nodes)
    return nodes


class Reach(NamedTuple):
    """Per frequency node: highest friction, and voltage and current for a target, infinite where
    out of reach.
    """

    cof_high: np.ndarray
    voltage_v: np.ndarray
    current_rms_a: np.ndarray


@pytest.fixture(scope="session")
def brute_force(surface, grid):
    """Every frequency node of the surface tried in turn, in numpy: (normal_force_n, target_cof) ->
    Reach.
    """

    def reach(normal_force_n: float, target_cof: float) -> Reach:
        place = np.interp(
            np.log(normal_force_n), np.log(grid.normal_force_n), np.arange(grid.normal_force_n.size)
        )
        j = min(int(place), grid.normal_force_n.size - 2)
        share = place - j
        rows = (1.0 - share) * surface.cof[:, j] + share * surface.cof[:, j + 1]
        currents = (1.0 - share) * surface.current_rms_a[:, j] + share * surface.current_rms_a[
            :, j + 1
        ]
        limit_v = np.minimum(surface.voltage_limit_v[:, j], surface.voltage_limit_v[:, j + 1])
        high = np.array(
            [np.interp(v, grid.voltage_v, row) for v, row in zip(limit_v, rows, strict=True)]
        )
        voltage = np.array([np.interp(target_cof, row, grid.voltage_v) for row in rows])
        current = np.array(
            [np.interp(v, grid.voltage_v, row) for v, row in zip(voltage, currents, strict=True)]
        )
        there = high >= target_cof
        return Reach(high, np.where(there, voltage, np.inf), np.where(there, current, np.inf))

    return reach


@pytest.fixture(scope="session")
def make_file():
    """A surface file by hand: friction 0.5 + `rise` V^2, `rise` [f, n], and whatever else differs
    from a plain one.
    """

    def make(
        frequency_hz: Any, normal_force_n: Any, voltage_v: Any, rise: Any = 1e-4, **changed: Any
    ) -> SurfaceFile:
        f, n, v = (np.asarray(x, dtype=float) for x in (frequency_hz, normal_force_n, voltage_v))
        shape = (f.size, v.size, n.size)
        coefficient = np.broadcast_to(np.asarray(rise, dtype=float), (f.size, n.size))
        arrays = {
            "cof": 0.5 + coefficient[:, None, :] * v[:, None] ** 2,
            "electrostatic_force_n": np.broadcast_to(1e-4 * v[:, None] ** 2, shape).copy(),
            "current_rms_a": np.broadcast_to(1e-7 * v[:, None], shape).copy(),
            "stuck_current_a_per_v": np.full(shape[:2], 1e-6),
            "stuck_density_a_per_v_m2": np.full(shape[:2], 1e-2),
            "electrode_gain": np.ones(shape[:2]),
            "slew_v_per_s": 2.0 * np.pi * f[:, None] * v,
            "pulled_in": np.zeros(shape, bool),
            "within_theory": np.ones(shape, bool),
            "within_limits": np.ones(shape, bool),
        }
        model = {
            "name": "by hand",
            "friction_law": "applied_load",
            "parameters": {"cof_off": {"value": 0.5}},
        }
        return SurfaceFile(f, v, n, **(arrays | changed), provenance={"model": model})

    return make


class Outcome(NamedTuple):
    """What one command line did."""

    status: int
    out: str
    err: str

    @property
    def said(self) -> dict[str, Any]:
        """All of stdout, which is one line with one object of strict JSON."""
        return one_object(self.out)


@pytest.fixture
def haptic(capsys):
    """Run one command line in this process."""

    def run(*arguments: object) -> Outcome:
        status = main([str(a) for a in arguments])
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run
