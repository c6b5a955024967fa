"""Ten minutes of rendering on a finger that becomes moist and dries, with a film that builds up:
what a refit is worth.

The finger is that of the blind generator, which shares no code with the model; its moisture has
another form than the catalogue's. Time is simulated, one tick per millisecond, and the drive an
envelope on a carrier of 200 Hz. Limits of contact current are lifted, so that 10 kHz reaches some
friction. Judged is the friction behind wobble and sensor noise. Without a force sensor the load is
taken for the usual one, or estimated with friction from readings of the electrode.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from benchmarks.claim import Claim
from haptic_driver.config import texture_dirs
from haptic_driver.limits import OperatingLimits
from haptic_driver.live.agreement import Agreement
from haptic_driver.live.comparison import compared
from haptic_driver.live.follow import MOST_WINDOWS
from haptic_driver.live.proof import LEAST_UNSEEN, attempt
from haptic_driver.live.touch_by_current import TouchByCurrent
from haptic_driver.live.window import NONE_YET, Window, windows
from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.render import envelope
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.feedback import Estimate, FeedbackSettings, Gains, elsewhere
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import table_of
from haptic_driver.render.tick import Tick, TickSettings, TickState, tick
from haptic_driver.signals import SLIDING_M_S, WITHIN, Array, FingerSample
from haptic_driver.textures.library import load_texture
from hw.finger.plant import FingerPlant
from hw.monitor.contract import ElectrodeReading
from model.description import ModelDescription
from tests.blind.generator.effects_electric import skin_hydration
from tests.blind.generator.electrode import touch_admittance
from tests.blind.generator.nuisance import ROUGHNESS, draw_finger
from tests.blind.generator.touch import Finger, Rows, friction, prepare

TICK_S = 0.001
LATENCY_TICKS = 3
LATENCY_S = 0.003  # from a tick to its effect
BUDGET_S = {"sensor": 0.0, "tick": 0.0005, "envelope": 0.002, "instrument": 0.001, "total": 0.0035}
CARRIER_HZ, OTHER_HZ = 200.0, 10e3
LIMITS = OperatingLimits(150.0, 1.0, 1e6, contact_current_a_rms=((1.0, 1.0), (1e6, 1.0)))
AXES = SurfaceAxes(
    frequency_low_hz=100.0, frequency_high_hz=20e3, frequency_count=40, voltage_count=76
)
LAW = FeedbackSettings(LATENCY_TICKS * TICK_S)
FIXED, GAINS, REFIT = ARMS = ("fixed model", "two gains", "refit")
CURRENT = "current only"
TEXTURES = ("grating", "linen")
FINGERS = (1, 2)  # seeds
WORKERS = 2
DURATION_S, VISIT_S, PERIOD_S = (
    600.0,
    10.0,
    60.0,
)  # of sliding, once in a period, off the screen in between
REFIT_EVERY_S, HELD_OUT_S, CHANGE_EVERY_S = 5.0, 2.0, 2.5
WOBBLE, WOBBLE_S, NOISE_N = 0.02, 0.010, 0.003
RISES = 0.2  # of friction without voltage, from dry to moist
USUAL_N, READ_EVERY_S, CURRENT_NOISE = (
    0.5,
    0.02,
    0.01,
)  # without a force sensor; the noise is relative, of each part
STRAY_F, STRAY_OFF = 300e-12, 0.01  # so well does the open circuit tell it
NODES_S = 10.0
V2_NODES = np.linspace(0.0, 150.0**2, 31)
LOAD_NODES = np.geomspace(0.15, 1.2, 8)


class Skin:
    """Friction and current per volt of one independent finger over time: tables over load and
    voltage squared, every NODES_S. `cof_off`: friction without voltage when dry, if not the
    finger's own; wet it is a share `rises` higher.
    """

    def __init__(
        self, seed: int, frequency_hz: float, cof_off: float | None = None, rises: float = RISES
    ) -> None:
        rng = np.random.default_rng(seed)
        finger, wettest, film_m = (
            draw_finger(rng),
            rng.uniform(0.8, 1.6),
            rng.uniform(0.02e-6, 0.10e-6),
        )
        own = rng.uniform(0.42, 0.55)
        self._finger = replace(finger, mu_off=own if cof_off is None else cof_off)
        self._wettest, self._film_m = wettest, film_m
        self._hz, self._rises = frequency_hz, rises
        self._tables: dict[int, NDArray[np.complex128]] = {}

    def at(self, time_s: float, load_n: float) -> Array:
        """Coefficient of friction over V2_NODES."""
        return self._at(time_s, load_n)[0].real

    def admittance_s(self, time_s: float, power_v2: float, load_n: float) -> complex:
        """Current per volt, the stray one not included."""
        return complex(np.interp(power_v2, V2_NODES, self._at(time_s, load_n)[1]))

    def _at(self, time_s: float, load_n: float) -> NDArray[np.complex128]:
        k, share = divmod(time_s / NODES_S, 1.0)
        position = np.log(load_n / LOAD_NODES[0]) / np.log(LOAD_NODES[1] / LOAD_NODES[0])
        j, b = divmod(min(max(position, 0.0), LOAD_NODES.size - 1.001), 1.0)
        first, then = (self._table(int(k) + n)[int(j) : int(j) + 2] for n in (0, 1))
        between = (1.0 - share) * ((1.0 - b) * first[0] + b * first[1]) + share * (
            (1.0 - b) * then[0] + b * then[1]
        )
        return np.asarray(between)

    def _table(self, k: int) -> NDArray[np.complex128]:
        if k not in self._tables:
            share = k * NODES_S / 600.0
            wet = np.sin(np.pi * share) ** 2
            rubs = self._finger.mu_off * (1.0 + self._rises * wet)
            now = replace(self._finger, mu_off=rubs, gap_offset=self._film_m * share)
            self._tables[k] = table(now, self._wettest * wet, self._hz)
        return self._tables[k]

    def cof(self, time_s: float, voltage_v: float, load_n: float) -> float:
        return float(np.interp(voltage_v**2, V2_NODES, self.at(time_s, load_n)))


def table(finger: Finger, wetness: float, frequency_hz: float) -> NDArray[np.complex128]:
    """Friction and current per volt over LOAD_NODES and V2_NODES [n, 2, m]."""
    load_n, v2 = (grid.ravel() for grid in np.meshgrid(LOAD_NODES, V2_NODES, indexing="ij"))
    rows = Rows(
        np.full(v2.size, frequency_hz),
        np.sqrt(v2),
        load_n,
        np.full(v2.size, 0.02),
        np.zeros(v2.size),
    )
    state = prepare(rows, finger, ROUGHNESS)
    skin_hydration(state, wetness, {"fall": 1.0}, True)
    both = np.stack([friction(state), touch_admittance(state)]).reshape(
        2, LOAD_NODES.size, V2_NODES.size
    )
    return both.transpose(1, 0, 2)


class Result(NamedTuple):
    """One finger, texture and arm: share of reachable sliding time within 5 %, how far friction is
    off then, relative, in the root mean square; friction right after a change of carrier relative
    to what was wanted [n], the same had the rise's gain been held over, jumps of voltage at swaps
    [m], V, and how many models were refit and dropped.
    """

    within: float
    error: float
    changed: Array
    held: Array
    jumps_v: Array
    refits: int
    dropped: int


class Arm:
    """The tick's stages with one way of knowing the finger."""

    def __init__(self, kind: str, texture: str) -> None:
        self.kind = kind
        self.file_model = self.model = load_model("reference")
        finger = FingerSettings(output_latency_s=LATENCY_S)
        self.stages = TickSettings(
            finger,
            load_texture(texture, texture_dirs()),
            self.controller(self.model),
            LIMITS,
            DriveSettings(),
            table_of(build_surface(self.model, LIMITS, AXES).worst_case(LIMITS)),
        )
        self.other = self.controller(self.model, OTHER_HZ)
        self.rows: deque[Window] = deque(maxlen=MOST_WINDOWS)
        self.counted = NONE_YET
        self.said: list[ModelDescription | None] = []

    def controller(self, model: ModelDescription, frequency_hz: float = CARRIER_HZ) -> Controller:
        surface = ready_for_lookup(build_surface(model, LIMITS, AXES), LIMITS)
        law = {FIXED: None, CURRENT: LAW._replace(off_share=0.0)}.get(self.kind, LAW)
        return Controller(
            ControllerSettings(surface, LIMITS, "fixed_frequency", frequency_hz, feedback=law)
        )

    def learn(self, samples: np.ndarray, state: TickState, speed_m_s: float) -> TickState:
        """Rows of the last seconds; with a refit, another surface where that is better."""
        end_s = samples["time_s"][-1]
        new, self.counted = windows(samples, BUDGET_S, self.counted)
        self.rows += new
        seen = [r for r in self.rows if r.time_s < end_s - HELD_OUT_S]
        unseen = [r for r in self.rows if r.time_s >= end_s - HELD_OUT_S]
        found = None
        if len(unseen) >= LEAST_UNSEEN and seen:
            found = attempt(seen, unseen, self.file_model, self.model).model
        self.said.append(found)
        if found is None:
            return state
        self.model, before = found, self.stages.controller
        self.stages = replace(self.stages, controller=self.controller(self.model))
        self.other = self.controller(self.model, OTHER_HZ)
        voltage_v, contact_s = state.command.voltage_v, end_s
        carried = self.stages.controller.carried(
            before, state.controller, speed_m_s, contact_s, voltage_v
        )
        return state._replace(controller=carried)


def slid(time_s: float) -> tuple[float, float, float]:
    """Position, speed and load of the finger: strokes of 60 mm at up to 47 mm/s."""
    phase = 2.0 * np.pi * time_s / 4.0
    load_n = 0.5 * np.exp(
        0.35 * np.sin(2.0 * np.pi * time_s / 37.0) + 0.15 * np.sin(2.0 * np.pi * time_s / 3.1)
    )
    return 0.03 * np.sin(phase), 0.03 * 2.0 * np.pi / 4.0 * np.cos(phase), load_n


class Bench:
    """One finger rendered on by one arm."""

    def __init__(self, kind: str, texture: str, seed: int, *finger: float) -> None:
        self.skin, self.other = (Skin(seed, hz, *finger) for hz in (CARRIER_HZ, OTHER_HZ))
        self.arm, self.state = Arm(kind, texture), TickState()
        self._rng = np.random.default_rng([seed, 1])
        self.off: list[float] = []
        self.changed: list[float] = []
        self.held: list[float] = []
        self.jumps_v: list[float] = []

    def visit(self, begin_s: float) -> None:
        """The finger comes, slides and goes; the arm learns of it."""
        count, kept = round(VISIT_S / TICK_S), np.exp(-TICK_S / WOBBLE_S)
        made, noise = np.zeros(count, SAMPLE), self._rng.standard_normal((count, 3))
        now_s, wobble, on_way = begin_s, 0.0, deque([0.0] * LATENCY_TICKS)
        plant = FingerPlant(lambda f, v, n, s: n * self.skin.cof(now_s, v, n))
        for i in range(count):
            now_s = begin_s + TICK_S * i
            position_m, speed_m_s, load_n = slid(now_s)
            plant.step(TICK_S, CARRIER_HZ, on_way.popleft() ** 0.5, load_n, abs(speed_m_s))
            wobble = kept * wobble + (1.0 - kept**2) ** 0.5 * noise[i, 0]
            lateral_n = plant.lateral_force_n * (1.0 + WOBBLE * wobble) + NOISE_N * noise[i, 1]
            force = self.sensed(now_s, load_n, on_way[0]) or (
                load_n + NOISE_N * noise[i, 2],
                lateral_n,
            )
            sample = FingerSample(now_s, position_m, 0.0, *force)
            done, power_v2 = self.tick(sample)
            on_way.append(power_v2)
            made[i] = told(i, speed_m_s, sample, done)
            if abs(speed_m_s) > SLIDING_M_S and done.finger.in_contact:
                self.judge(now_s, position_m, load_n, plant.lateral_force_n, done)
                if i % round(CHANGE_EVERY_S / TICK_S) == 0:
                    known = self.state.controller.estimate
                    there = elsewhere(LAW, known, CARRIER_HZ, OTHER_HZ)
                    self.changed += carrier_changed(self.arm, there.gains, self.other, now_s, done)
                    self.held += carrier_changed(self.arm, known.gains, self.other, now_s, done)
            if self.arm.kind == REFIT and (i + 1) % (every := round(REFIT_EVERY_S / TICK_S)) == 0:
                self.refit(made[i + 1 - every : i + 1], sample, abs(speed_m_s))
        self.state, _ = tick(
            self.arm.stages, self.state, FingerSample(now_s + TICK_S, position_m, 0.0, 0.0)
        )

    def sensed(self, now_s: float, load_n: float, power_v2: float) -> tuple[float, float] | None:
        """Load and lateral force as known without a force sensor; None with one."""
        return None

    def refit(self, made: np.ndarray, sample: FingerSample, speed_m_s: float) -> None:
        """The arm learns; how far the voltage of one and the same sample jumps by that."""
        before, old = self.state, self.arm.stages
        self.state = self.arm.learn(made, before, speed_m_s)
        ways = (old, before), (self.arm.stages, self.state)
        voltages_v = [tick(stages, state, sample)[1].command.voltage_v for stages, state in ways]
        self.jumps_v.append(voltages_v[1] - voltages_v[0])

    def tick(self, sample: FingerSample) -> tuple[Tick, float]:
        """One tick, and the mean square of the course that follows it."""
        stages = self.arm.stages
        self.state, done = tick(stages, self.state, sample)
        power_v2 = done.command.voltage_v**2
        if done.command.voltage_v == done.wanted.voltage_v:
            self.state, course_v2 = envelope.ahead(stages, self.state, done, TICK_S)
            power_v2 = float(course_v2.mean())
        return done, power_v2

    def judge(
        self, now_s: float, position_m: float, load_n: float, lateral_n: float, done: Tick
    ) -> None:
        """Whether friction is the texture's, where that is in reach."""
        target = self.arm.stages.texture.cof_under(
            done.finger._replace(position_x_m=position_m, position_y_m=0.0)
        )
        in_reach = self.skin.at(now_s, load_n)[[0, -1]]
        if in_reach[0] <= target <= in_reach[1]:
            self.off.append(lateral_n / load_n / target - 1.0)


class WithoutSensor(Bench):
    """The same where nobody measures force; with current, by what a monitor reads of the electrode
    now and then.
    """

    def __init__(self, kind: str, texture: str, seed: int, *finger: float) -> None:
        super().__init__(kind, texture, seed, *finger)
        self._touch, self._known, self._read_s = (
            TouchByCurrent(self.arm.model, USUAL_N),
            (USUAL_N, np.nan),
            -np.inf,
        )
        self._stray_s = 2j * np.pi * CARRIER_HZ * STRAY_F * STRAY_OFF * self._rng.standard_normal()

    def sensed(self, now_s: float, load_n: float, power_v2: float) -> tuple[float, float]:
        if self.arm.kind == CURRENT and now_s - self._read_s >= READ_EVERY_S:
            real, imaginary = CURRENT_NOISE * self._rng.standard_normal(2)
            current_a = power_v2**0.5 * (
                self.skin.admittance_s(now_s, power_v2, load_n) + self._stray_s
            )
            current_a *= 1.0 + real + 1j * imaginary
            reading = ElectrodeReading(
                power_v2**0.5, 0.0, current_a, CURRENT_NOISE * abs(current_a)
            )
            felt = self._touch.felt(CARRIER_HZ, reading, min(now_s - self._read_s, PERIOD_S))
            lateral_n = felt.load_n * felt.cof if felt.tells else np.nan
            self._known, self._read_s = (felt.load_n, lateral_n), now_s
        return self._known


def render(case: tuple[str, str, int]) -> Result:
    """One arm, texture and finger."""
    return judged(Bench(*case))


def judged(bench: Bench) -> Result:
    """What came of ten minutes."""
    for begin_s in np.arange(0.0, DURATION_S, PERIOD_S):
        bench.visit(float(begin_s))
    refits = sum(found is not None for found in bench.arm.said)
    off = np.array(bench.off)
    found = (
        *map(np.array, (bench.changed, bench.held, bench.jumps_v)),
        refits,
        len(bench.arm.said) - refits,
    )
    return Result(float(np.mean(np.abs(off) <= WITHIN)), rms(off), *found)


def told(i: int, speed_m_s: float, sample: FingerSample, done: Tick) -> np.void:
    """What the ring keeps of a tick."""
    kept = np.zeros((), SAMPLE)
    kept["tick"], kept["time_s"], kept["speed_m_s"] = i, sample.time_s, abs(speed_m_s)
    kept["normal_force_n"], kept["lateral_force_n"] = sample.normal_force_n, sample.lateral_force_n
    kept["in_contact"], kept["frequency_hz"] = done.finger.in_contact, done.command.frequency_hz
    kept["voltage_v"], kept["output_on"] = done.command.voltage_v, done.command.voltage_v > 0.0
    kept["measured_cof"] = abs(sample.lateral_force_n) / sample.normal_force_n
    kept["felt_time_s"], kept["asked_time_s"] = sample.time_s, sample.time_s + LATENCY_S
    return kept


def carrier_changed(arm: Arm, gains: Gains, other: Skin, now_s: float, done: Tick) -> list[float]:
    """By how much friction is off, relative, at the first tick on another carrier, for two
    frictions in reach there.
    """
    load_n = done.finger.normal_force_n
    wanted = np.array([other.cof(now_s, voltage_v, load_n) for voltage_v in (70.0, 110.0)])
    voltages_v, _ = arm.other.along(Estimate(gains), wanted, done.finger, OTHER_HZ)
    felt = [other.cof(now_s, float(voltage_v), load_n) for voltage_v in voltages_v]
    return (np.array(felt) / wanted - 1.0).tolist()


def run() -> Iterator[Claim]:
    cases = list(product(ARMS, TEXTURES, FINGERS))
    with ProcessPoolExecutor(WORKERS) as pool:
        found = dict(zip(cases, pool.map(render, cases), strict=True))
    for texture, arm in product(TEXTURES, ARMS):
        within = [found[arm, texture, finger].within for finger in FINGERS]
        wanted = ("at least 95 %", min(within) >= 0.95) if arm == REFIT else ()
        yield Claim(
            f"{texture}, {arm}: sliding time within 5 % of a target in reach",
            spread(within),
            *wanted,
        )
    for texture in TEXTURES:
        errors = {
            arm: [rms(found[arm, texture, finger].changed) for finger in FINGERS] for arm in ARMS
        }
        for arm in ARMS:
            yield Claim(
                f"{texture}, {arm}: error of friction right after 200 Hz -> 10 kHz",
                spread(errors[arm]),
            )
        held = [rms(found[GAINS, texture, finger].held) for finger in FINGERS]
        yield Claim(
            f"{texture}, {GAINS}: the same, had the rise's gain been held over", spread(held)
        )
        for name, others, *wanted in (
            (f"{GAINS} held over", held, "at most a third"),
            (GAINS, errors[GAINS]),
        ):
            ratios = [ours / gains for ours, gains in zip(errors[REFIT], others, strict=True)]
            judged = (*wanted, float(np.mean(ratios)) <= 1.0 / 3.0) if wanted else ()
            yield Claim(
                f"{texture}: that error after a refit, as a share of {name}",
                spread(ratios),
                *judged,
            )
    refit = [result for (arm, _, _), result in found.items() if arm == REFIT]
    jump_v = max(float(np.abs(result.jumps_v).max()) for result in refit)
    rate_v = DriveSettings().voltage_rise_v_per_s * TICK_S
    yield Claim(
        "jump of the voltage at a swap",
        f"{jump_v:.2g} V at most",
        f"at most {rate_v:g} V",
        jump_v <= rate_v,
    )
    counts = sum(result.refits for result in refit), sum(result.dropped for result in refit)
    yield Claim("models refit, and dropped as no better", f"{counts[0]}, {counts[1]}")
    yield from agreement()


def rms(values: Array | list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def spread(shares: list[float]) -> str:
    """In the mean over fingers, and from the least to the most."""
    return f"{100.0 * np.mean(shares):.1f} % ({100.0 * min(shares):.1f}..{100.0 * max(shares):.1f})"


def agreement() -> Iterator[Claim]:
    """The test that runs along, on windows of a described finger, and on 5 % less friction in one
    place.
    """
    rng, hours = np.random.default_rng(5), 8.0
    fingers, changes = 5, 40
    false = sum(len(alarms(rng, 3600.0 * hours, lambda _: False)) for _ in range(fingers))
    low, high = (
        0.5 * chi2.ppf(q, 2 * (false + k)) if false + k else 0.0
        for q, k in ((0.025, 0), (0.975, 1))
    )
    yield Claim(
        f"agreement: false alarms in {hours:g} h of sliding, finger described",
        f"{false / fingers:.1f} (95 %: {low / fingers:.2f}..{high / fingers:.2f})",
        "at most 1",
        false <= fingers,
    )
    places: dict[str, Callable[[Window], bool]] = {
        "above 75 V": lambda at: at.voltage_v > 75.0,
        "above 0.6 N": lambda at: at.normal_force_n > 0.6,
    }
    for name, where in places.items():
        told = [alarms(rng, 900.0, where, 600.0) for _ in range(changes)]
        delays = np.array(
            [min((t for t in times if t >= 600.0), default=np.inf) - 600.0 for times in told]
        )
        low_s, high_s = np.quantile(delays, (0.05, 0.95), method="nearest")
        missed = int(np.sum(delays > 60.0))
        ends = (
            beta.ppf(0.025, missed, changes - missed + 1) if missed else 0.0,
            beta.ppf(0.975, missed + 1, changes - missed),
        )
        yield Claim(
            f"agreement: 5 % less friction {name}: delay, and missed within 60 s",
            f"{np.median(delays):.0f} s in the median ({low_s:.0f}..{high_s:.0f} in 90 of 100); "
            f"{missed} of {changes} (95 %: {ends[0]:.0%}..{ends[1]:.0%})",
            "median within 60 s",
            bool(np.median(delays) <= 60.0),
        )


def alarms(
    rng: np.random.Generator,
    duration_s: float,
    where: Callable[[Window], bool],
    since_s: float = 0.0,
) -> list[float]:
    """When the test speaks, over windows of one carrier as a texture makes them: five in a second,
    3 % of scatter.
    """
    test, times = Agreement(), []
    for i in range(round(duration_s / 0.2)):
        time_s = 0.2 * i
        v, n, s = (float(rng.uniform(*ends)) for ends in ((0.0, 130.0), (0.3, 0.9), (0.01, 0.08)))
        noise, stated = 0.03 * rng.standard_normal(), 0.03 * np.sqrt(rng.chisquare(8) / 8)
        made = Window(CARRIER_HZ, v, n, s, float(np.exp(noise)), 0.0, time_s, 0.2, 1, 1)
        made = made._replace(cof_std=float(stated) * made.cof)
        if time_s >= since_s and where(made):
            made = made._replace(cof=made.cof * 0.95, cof_std=made.cof_std * 0.95)
        off, std = compared([made], np.ones(1))
        if test.add(made, float(off[0]), float(std[0])):
            times.append(time_s)
    return times
