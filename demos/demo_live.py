"""Live: linen under a finger that becomes moist, on a daemon in real time; the model is refit
while it renders.

`python demos/demo_live.py --out DIR` draws friction before, meanwhile and after, and the page as
a user sees it. Feedback is off, so that friction shows what the model is worth. To name what has
changed takes several carriers: the same linen is slid over at two more. There the simulated rig's
limit of contact current leaves little force; here the limit is that for workers, which is twice.
"""

from __future__ import annotations

import argparse
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_driver.config import find_config
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState, RefusedError, Why
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.run import PAGE_FOLDER
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.daemon.web.server import serve
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.fidelity.said import said
from haptic_driver.fidelity.samples import fidelity_of_samples, sliding
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import take_precedence
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import Array
from haptic_driver.simulation.finger_model import FrictionLaw, surface_friction, with_hidden
from model.touch_model import TouchModel

RIG, MODEL, TEXTURE = "simulated-envelope", "reference", "linen"
CARRIERS_HZ = (200.0, 2e3, 10e3)
OF_WORKERS = ((1.0, 1e-3), (2.5e3, 1e-3), (100e3, 40e-3), (10e6, 40e-3))  # Hz, A rms: ICNIRP 2010
DRY_S, MOISTENING_S, WETNESS = (
    17.0,
    4.0,
    1.2,
)  # of the finger's life, and of the effect skin_hydration
BORN_S = time.monotonic()  # in the process of the simulated instruments, which imports this
STEPS = 5  # of wetness, between which friction is taken as even
LEASE_S = 20.0
PIECE = 100  # ticks, some threads long: a point of the picture
SHOWN_S, MOST_S = 7.0, 120.0  # of what is shown; and to wait for anything
ROWS = 50  # of another carrier, to ask why by: some 6 s of sliding


@cache
def stages() -> list[FrictionLaw]:
    """The finger from dry to moist."""
    limits = replace(load_rig(RIG).operating_limits(), contact_current_a_rms=OF_WORKERS)
    model = TouchModel(load_model(MODEL))
    wet = [
        with_hidden(model, {"skin_hydration": {"wetness": w}})
        for w in np.linspace(0.0, WETNESS, STEPS)
    ]
    return [surface_friction(build_surface(each.description, limits), limits) for each in wet]


def finger(
    frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: Array, touch_s: Array
) -> Array:
    """Lateral force of the finger, N [n]. How moist it is counts from its birth, not from its
    touch, which `touch_s` does.
    """
    laws, life_s = stages(), time.monotonic() - BORN_S
    along = min(max((life_s - DRY_S) / MOISTENING_S, 0.0), 1.0)
    moist = np.full(touch_s.size, along * (STEPS - 1))
    forces = []
    for at, share in zip(
        zip(frequency_hz, voltage_v, normal_force_n, speed_m_s, strict=True), moist, strict=True
    ):
        low = min(int(share), STEPS - 2)
        before, after = (laws[k](*map(float, at), 0.0) for k in (low, low + 1))
        forces.append(before + (share - low) * (after - before))
    return np.array(forces)


class Watching:
    """A daemon that renders the texture, and its ticks as they come; armed anew after a fault of a
    busy machine.
    """

    def __init__(self, daemon: Daemon) -> None:
        self._daemon, self._token, self._position = daemon, "", daemon.shared.ring.position
        self.samples: list[NDArray[np.void]] = []

    def hold(self) -> None:
        """Keep the lease, or get one."""
        try:
            self._daemon.renew(self._token)
        except RefusedError:
            with suppress(RefusedError):  # until the next time
                if self._daemon.status().state is DaemonState.FAULT:
                    self._daemon.reset()
                self._token = self._daemon.arm(LEASE_S, "the demo").token
                self._daemon.targets.play(self._token, TEXTURE, nearest=True)

    def until(self, done: Callable[[], object], what: str) -> None:
        """Watch until something is there. Raises TimeoutError."""
        until_s = time.monotonic() + MOST_S
        print(f"{what} ...", flush=True)
        while not done():
            if time.monotonic() > until_s:
                raise TimeoutError(f"{what}: not within {MOST_S:g} s")
            self.hold()
            time.sleep(0.5)
            taken = self._daemon.shared.ring.read(self._position)
            self._position = taken.position
            self.samples.append(taken.samples)

    def for_s(self, seconds: float, what: str) -> tuple[float, float]:
        """Watch for so long; from when to when that was."""
        began_s = time.monotonic()
        self.until(lambda: time.monotonic() >= began_s + seconds, what)
        return began_s, time.monotonic()


def errors(samples: NDArray[np.void]) -> tuple[Array, Array]:
    """By how much friction was off what was asked, relative, over each PIECE of ticks on the way;
    and when.
    """
    pieces = samples[: samples.size // PIECE * PIECE].reshape(-1, PIECE)
    known = sliding(pieces.ravel()) & np.isfinite(pieces.ravel()["target_cof"])
    felt = pieces[np.all(known.reshape(pieces.shape), axis=1)]
    return (
        felt["time_s"].mean(axis=1),
        felt["measured_cof"].mean(axis=1) / felt["target_cof"].mean(axis=1) - 1.0,
    )


def demonstrate(out: Path) -> None:
    """All of it; prints what it sees."""
    out.mkdir(parents=True, exist_ok=True)
    take_precedence()
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder, "demo.toml")
        text = find_config(RIG, "rigs").read_text()
        curve = f"contact_current_a_rms = {[list(point) for point in OF_WORKERS]}"
        rig.write_text(re.sub("^contact_current_a_rms = .*", curve, text, flags=re.MULTILINE))
        with compilation_said("demo"):
            settings = daemon_settings(str(rig), MODEL)
        settings = replace(settings, finger=f"{Path(__file__).resolve()}:finger", feedback=False)
        settings = replace(settings, carrier_hz=CARRIERS_HZ[0]).with_surface(settings.surface, 0)
        place = Place(Path(folder, "daemon.sock"))
        try:
            with Daemon(settings) as daemon, serve(daemon, place, 0, page=PAGE_FOLDER) as page:
                _show(daemon, str(page), out)
        finally:
            place.close()


def _show(daemon: Daemon, page: str, out: Path) -> None:
    watching = Watching(daemon)

    def told(kind: str, beginning: str = "") -> bool:
        return any(
            event.kind == kind and event.message.startswith(beginning) for event in daemon.events(0)
        )

    def seen(carrier_hz: float) -> bool:
        """Whether there is enough of a carrier to ask why; a busy machine has gaps, of which there
        are no rows.
        """
        rows = list(daemon.basis.observer.rows)
        return sum(row.frequency_hz == carrier_hz for row in rows) >= ROWS

    watching.until(lambda: daemon.status().output_on, "the output comes on")
    dry = watching.for_s(SHOWN_S, "a dry finger")
    watching.until(lambda: told("agreement"), "it becomes moist")
    print(f"  {daemon.status().disagreement}")
    watching.for_s(MOISTENING_S, "until it is moist")
    moist = watching.for_s(SHOWN_S, "as the model is")
    _page(page, out / "page.png")
    daemon.adapt(True)
    watching.until(lambda: told("adapt", "refitted"), "a refit")
    messages = (event.message for event in daemon.events(0))
    print(f"  {next(message for message in messages if message.startswith('refitted'))}")
    refit = watching.for_s(SHOWN_S, "as it is refit")
    for carrier_hz in CARRIERS_HZ[1:]:
        daemon.disarm()
        daemon.use_model(MODEL, carrier_hz, feedback=False)
        watching.until(partial(seen, carrier_hz), f"the same at {carrier_hz:g} Hz")
    daemon.disarm()
    daemon.basis.why((time.monotonic() - refit[0]) / 60.0)
    samples = np.concatenate(watching.samples)
    time_s, off = errors(samples)
    shares = {}
    for name, (start_s, end_s) in {"dry": dry, "moist": moist, "moist, refit": refit}.items():
        there = (samples["time_s"] > start_s) & (samples["time_s"] < end_s)
        found = fidelity_of_samples(samples[there], load_perception())
        shares[name] = (start_s, end_s, found.share_within_5_percent or 0.0)
        print(f"{name}: {said(found)[0]}")
    print("haptic why ...", flush=True)
    while (why := daemon.basis.inquiry.answer).state == "running":
        time.sleep(0.5)
    print(f"  {why.said}")
    _draw(time_s, off, shares, why, out / "live.png")
    made = f"picture: {out / 'live.png'}; page: {out / 'page.png'}"
    if why.report is not None:  # which goes with the daemon
        shutil.copytree(Path(why.report).parent, out / "why", dirs_exist_ok=True)
        made += f"; report: {out / 'why' / 'report.html'}"
    print(made)


def _draw(
    time_s: Array, off: Array, shares: dict[str, tuple[float, float, float]], why: Why, path: Path
) -> None:
    figure, axes = pyplot().subplots(figsize=(9.0, 4.0), layout="constrained")
    title = f"haptic why: {why.verdict}; most probable {', '.join(list(why.suspects)[:3])}"
    with saved(figure, path):
        axes.axhspan(-5.0, 5.0, color="#dff1e4")
        axes.plot(time_s - time_s[0], 100.0 * off, ".", markersize=3.0, color="#1b6ca8")
        for name, (start_s, end_s, share) in shares.items():
            axes.axvspan(start_s - time_s[0], end_s - time_s[0], color="#8593a3", alpha=0.12)
            axes.text(
                0.5 * (start_s + end_s) - time_s[0], 21.0, f"{name}: {share:.0%}", ha="center"
            )
        axes.set(
            xlabel="time, s", ylabel="friction off the texture, %", ylim=(-25.0, 25.0), title=title
        )


def _page(url: str, path: Path) -> None:
    """The page in a browser, where there is one."""
    chromium = next(
        (
            found
            for name in ("chromium", "chromium-browser", "google-chrome")
            if (found := shutil.which(name))
        ),
        None,
    )
    try:
        from playwright.sync_api import expect, sync_playwright  # noqa: PLC0415
    except ImportError:
        chromium = None
    if chromium is None:
        print("no browser: no picture of the page")
        return
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        view = browser.new_page(viewport={"width": 1700, "height": 1150})
        view.goto(url)
        expect(view.locator("#state")).not_to_have_text(
            "UNKNOWN", timeout=30_000
        )  # no script: the page allows none
        view.wait_for_timeout(5000)  # tiles and thumbnails come one by one
        view.screenshot(path=path)
        browser.close()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/demo-live"))
    demonstrate(parser.parse_args().out)


if __name__ == "__main__":
    main()
