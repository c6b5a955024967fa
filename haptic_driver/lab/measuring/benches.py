"""Which bench a plan is measured on, and what somebody has done at it before."""

from __future__ import annotations

from collections.abc import Callable

from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.run import Experiment
from haptic_driver.lab.measuring.simulated_stages import SimulatedStageBench
from haptic_driver.lab.measuring.stage_bench import StageBench
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.sealed import opened, seal
from haptic_driver.simulation.finger_function import FingerFunction
from model.effects.interventions import removed


def bench_for(
    experiment: Experiment,
    first_row: int,
    finger: FingerFunction | None,
    tell: Callable[[str], None],
) -> SimulatedBench | StageBench:
    """The simulated rig with that finger, or with its own, or the real one; to be entered. A rig
    with a stage slides by it.
    """
    config = experiment.config
    if not config.simulated:
        return StageBench(config, experiment.plan, tell)
    friction, electrode = (None, None) if finger is None else (finger.friction, finger.electrode)
    bench = SimulatedBench(
        carried_out(config, experiment.plan.intervention),
        experiment.model,
        seed=experiment.seed,
        first_row=first_row,
        friction=friction,
        electrode=electrode,
    )
    if config.stage is None:
        return bench
    return SimulatedStageBench(config, experiment.plan, bench, tell)


def carried_out(config: RigConfig, intervention: str) -> RigConfig:
    """A simulated rig once an intervention is done: what is hidden in its finger has lost what that
    removes.
    """
    gone, simulation = removed(intervention), config.simulation
    sealed = opened(simulation.sealed)
    hide, inside = (
        {name: values for name, values in some.items() if name not in gone}
        for some in (simulation.hide, sealed.hide)
    )
    left = {"hide": hide, "sealed": seal(sealed.model_copy(update={"hide": inside}))}
    return config.model_copy(update={"simulation": simulation.model_copy(update=left)})
