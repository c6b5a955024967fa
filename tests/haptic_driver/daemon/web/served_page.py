"""The page in a real browser, in front of the real API; the daemon behind it is `bench_control.py`.
Not a test.

The textures it shows are those of the library, drawn by the daemon's own code.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import time
import urllib.request
from base64 import b64encode
from urllib.parse import urlsplit

import numpy as np
import pytest

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.messages import DaemonState, Tile
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.run import PAGE_FOLDER
from haptic_driver.daemon.web.server import serve
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.textures.library import load_texture
from haptic_driver.textures.tile import Grid, cell_means, levels
from tests.haptic_driver.daemon.bench_control import BenchControl

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
HANG_MS = 60_000
HANG_S = HANG_MS / 1e3

if os.environ.get("CI") != "true":
    pytest.importorskip("playwright", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium in the path", allow_module_level=True)

from playwright.sync_api import Error as BrowserError  # noqa: E402, F401 - only where it is installed
from playwright.sync_api import expect  # noqa: E402

expect.set_options(timeout=HANG_MS)


class SlidingControl(BenchControl):
    """A finger that goes round on the screen, with a tick per millisecond of the clock; friction
    grows with y.
    """

    def __init__(self):
        super().__init__()
        self.lifted = False
        self.aside_m = 0.0

    def samples(self, since_tick, most):
        newest = int(time.monotonic() * 1e3)
        ticks = np.arange(max(since_tick + 1, newest - most + 1), newest + 1)
        made = np.zeros(ticks.size, SAMPLE)
        made["tick"], made["time_s"] = ticks, ticks * 1e-3
        angle = 2.0 * math.pi * made["time_s"]
        for prefix in ("position", "output"):
            made[f"{prefix}_x_m"] = 0.03 + 0.02 * np.cos(angle) + self.aside_m
            made[f"{prefix}_y_m"] = 0.03 + 0.02 * np.sin(angle)
        made["lateness_s"] = 5e-6 * (1.0 + np.cos(angle))
        made["in_contact"], made["normal_force_n"] = not self.lifted, 0.5
        made["measured_cof"] = np.nan if self.lifted else 0.7 + 0.2 * np.sin(angle)
        rendering = self.machine.state is DaemonState.RENDERING
        made["target_cof"] = self.cof if rendering and self.cof else np.nan
        made["output_on"], made["frequency_hz"] = rendering, 250.0 if rendering else 0.0
        made["voltage_v"] = (25.0 + 10.0 * np.sin(angle)) if rendering else 0.0
        return made

    def textures(self):
        return ["braille", "fine_grating", "grating", "linen", *self.scripts()]

    def scripts(self):
        return ["steps"]

    def tile(self, asked):
        texture = load_texture(asked.name, texture_dirs())
        low, high = texture.bounds()
        cof = cell_means(
            texture, Grid(asked.x_m, asked.y_m, asked.pitch_m, asked.columns, asked.rows)
        )
        said = b64encode(levels(cof, low, high)).decode()
        return Tile(columns=asked.columns, rows=asked.rows, cof_low=low, cof_high=high, levels=said)


class Served:
    """The API and the page at a port of its own, which may be ended and begun again."""

    def __init__(self, control, folder):
        self._control = control
        self.socket = folder / "daemon.sock"
        self._port = 0
        self.start()

    def start(self):
        self._place = Place(self.socket)
        self._serving = serve(self._control, self._place, self._port, page=PAGE_FOLDER)
        self.url = self._serving.__enter__()
        self._port = urlsplit(self.url).port

    def stop(self):
        self._serving.__exit__(None, None, None)
        self._place.close()

    @property
    def token(self):
        return self.url.partition("token=")[2]

    def ask(self, path):
        """What the API says, asked by another client."""
        request = urllib.request.Request(
            f"http://127.0.0.1:{self._port}{path}",
            headers={"Authorization": f"Bearer {self.token}"},
        )
        with urllib.request.urlopen(request, timeout=HANG_S) as answer:
            return json.load(answer)


# On a busy machine an answer may take longer than the 5 s that the page gives it.
PATIENT = (
    "{ const usual = AbortSignal.timeout.bind(AbortSignal); AbortSignal.timeout = (ms) => usual(6 *"
    " ms); }"
)

# First of all who hear that the page is left; a report inside it may run no scripts.
QUIETLY = """
if (window === top)
  addEventListener("pagehide", (event) => { if (window.quietly) event.stopImmediatePropagation(); });
"""


def opened(browser, served, width=1280, height=800):
    """The page, connected; `page.complaints` is everything that it wrote to the console and every
    failure.
    """
    page = tab(browser, width, height)
    load(page, served)
    return page


def tab(browser, width=1280, height=800):
    """Where the page can be loaded."""
    page = browser.new_context(viewport={"width": width, "height": height}).new_page()
    page.set_default_timeout(HANG_MS)
    page.add_init_script(PATIENT + QUIETLY)
    page.on("console", lambda message: page.complaints.append(message.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("request", lambda request: page.requested.append(request.url))
    return page


def load(page, served):
    """The page from its beginning, connected."""
    page.complaints, page.requested = [], []
    page.goto(served.url)
    text(page, "#link", "connected")


def leave_quietly(page):
    """Away from the page, which does not disarm: what is served next hears nothing of it."""
    page.evaluate("window.quietly = true")
    page.goto("about:blank")


def text(page, selector, words):
    """Wait until an element says this."""
    expect(page.locator(selector)).to_have_text(words, timeout=HANG_MS)


def arm(page, lease_s="10"):
    """Wait until the page has armed, with a lease that a busy machine does not lose."""
    page.select_option("#lease_s", lease_s)
    page.click("#arm")
    text(page, "#state", "ARMED")


def arm_and_set(page, lease_s="10"):
    """Wait until a friction is rendered that the page has asked for."""
    arm(page, lease_s)
    page.fill("#cof", "0.65")
    page.click("#set button")
    text(page, "#state", "RENDERING")


def press_grey(page, selector):
    """A button that cannot work now: a browser's driver would wait for it for ever."""
    page.locator(selector).evaluate("(one) => one.scrollIntoView({ block: 'center' })")
    page.locator(selector).element_handle().wait_for_element_state("stable")
    page.locator(selector).click(force=True)
