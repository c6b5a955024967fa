"""The page in a real browser, in front of the real API; the daemon behind it is `bench_control.py`."""

import json
import math
import os
import shutil
import time
import urllib.request
from urllib.parse import urlsplit

import numpy as np
import pytest

from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.run import PAGE_FOLDER
from haptic_driver.daemon.web.server import serve
from haptic_driver.processes.samples import SAMPLE
from tests.haptic_driver.daemon.bench_control import BenchControl
from tests.waiting import until

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
HANG_MS = 60_000
HANG_S = HANG_MS / 1e3
PLOTS = ["friction", "surface", "finger", "lateness"]

if os.environ.get("CI") != "true":
    pytest.importorskip("playwright", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium in the path", allow_module_level=True)

from playwright.sync_api import Error as BrowserError  # noqa: E402 - only where it is installed
from playwright.sync_api import expect, sync_playwright  # noqa: E402


class SlidingControl(BenchControl):
    """A finger that goes round on the screen, with a tick per millisecond of the clock."""

    def samples(self, since_tick, most):
        newest = int(time.monotonic() * 1e3)
        ticks = np.arange(max(since_tick + 1, newest - most + 1), newest + 1)
        made = np.zeros(ticks.size, SAMPLE)
        made["tick"], made["time_s"] = ticks, ticks * 1e-3
        angle = 2.0 * math.pi * made["time_s"]
        for prefix in ("position", "output"):
            made[f"{prefix}_x_m"], made[f"{prefix}_y_m"] = 0.03 + 0.02 * np.cos(angle), 0.03 + 0.02 * np.sin(angle)
        made["lateness_s"] = 5e-6 * (1.0 + np.cos(angle))
        made["in_contact"], made["measured_cof"], made["normal_force_n"] = 1, 0.55 + 0.05 * np.sin(angle), 0.5
        rendering = self.machine.state is DaemonState.RENDERING
        made["target_cof"] = self.cof if rendering and self.cof else np.nan
        made["output_on"], made["frequency_hz"] = rendering, 250.0 if rendering else 0.0
        made["voltage_v"] = (25.0 + 10.0 * np.sin(angle)) if rendering else 0.0
        return made

    def texture_map(self):
        side_m = [0.001 * i for i in range(60)]
        return {"x_m": side_m, "y_m": side_m, "cof": [[0.5 + x_m for x_m in side_m] for _ in side_m]}


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def control():
    return SlidingControl()


class Served:
    """The API and the page at a port of its own, which may be ended and begun again."""

    def __init__(self, control, folder):
        self._control = control
        self._folder = folder
        self._port = 0
        self.start()

    def start(self):
        self._place = Place(self._folder / "daemon.sock")
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
            f"http://127.0.0.1:{self._port}{path}", headers={"Authorization": f"Bearer {self.token}"}
        )
        with urllib.request.urlopen(request, timeout=HANG_S) as answer:
            return json.load(answer)


@pytest.fixture
def served(control, tmp_path):
    served = Served(control, tmp_path)
    yield served
    served.stop()


@pytest.fixture
def page(browser, served):
    """The page, connected; `page.complaints` is everything that it wrote to the console and every failure."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.set_default_timeout(HANG_MS)
    page.complaints, page.requested = [], []
    page.on("console", lambda message: page.complaints.append(message.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("request", lambda request: page.requested.append(request.url))
    page.goto(served.url)
    expect(page.locator("#link")).to_have_text("connected", timeout=HANG_MS)
    yield page
    context.close()


def text(page, selector, words):
    expect(page.locator(selector)).to_have_text(words, timeout=HANG_MS)


def arm_and_set(page):
    page.click("#arm")
    text(page, "#state", "ARMED")
    page.fill("#cof", "0.65")
    page.click("#set button")
    text(page, "#state", "RENDERING")


def await_state(served, state):
    return until(lambda: (status := served.ask("/status"))["state"] == state and status)


def pixels(page, plot):
    return page.evaluate(f"document.getElementById('{plot}').toDataURL()")


def await_change(page, plot):
    before = pixels(page, plot)  # the page forbids scripts made of strings, so nothing in it can wait for us
    until(lambda: pixels(page, plot) != before, lambda: f"{plot} stands still")


def test_it_loads_without_complaint_and_asks_nobody_else(page, served):
    text(page, "#state", "IDLE")
    text(page, "#output", "OFF")
    expect(page.locator("#simulated")).to_be_visible()
    expect(page.locator("#texture option")).to_have_text(["grating", "linen"])
    text(page, "#events li .kind", "state")
    page.wait_for_timeout(500)
    assert page.complaints == []
    origin = served.url.partition("/page/")[0]
    assert len(page.requested) >= 6
    assert [url for url in page.requested if not url.startswith((origin + "/", "data:"))] == []


def test_the_token_does_not_stay_in_the_address(page, served):
    assert served.token not in page.url
    page.reload()
    text(page, "#link", "connected")


def test_a_page_without_the_token_says_that_it_is_not_connected(browser, served):
    context = browser.new_context()
    page = context.new_page()
    page.goto(served.url.partition("?")[0])
    text(page, "#link", "connection lost")
    expect(page.locator("#alarm")).to_contain_text("Connection to the daemon lost")
    context.close()


def test_the_plots_move(page):
    arm_and_set(page)
    for plot in PLOTS:
        await_change(page, plot)


@pytest.mark.parametrize("switch_off", [lambda page: page.click("#off"), lambda page: page.keyboard.press("Escape")])
def test_off_switches_off(page, served, control, switch_off):
    arm_and_set(page)
    assert served.ask("/status")["output_on"] is True
    page.focus("#cof")
    switch_off(page)
    assert await_state(served, "armed")["output_on"] is False
    assert ("off",) in control.calls
    text(page, "#output", "OFF")


def test_off_that_cannot_be_shown_is_not_called_off(page, control):
    arm_and_set(page)
    control.shown_off = False
    page.click("#off")
    text(page, "#output", "UNKNOWN")
    expect(page.locator("#refusal-message")).to_contain_text("nothing shows yet that the output is off")
    expect(page.locator("#alarm")).to_contain_text("emergency stop")


def test_a_texture_is_played_and_disarming_ends_the_lease(page, served):
    page.click("#arm")
    text(page, "#state", "ARMED")
    page.select_option("#texture", "linen")
    page.click("#play button")
    assert await_state(served, "rendering")["texture"] == "linen"
    page.click("#disarm")
    await_state(served, "idle")
    text(page, "#lease", "This page holds no lease.")


def test_the_page_renews_its_lease_and_leaving_it_disarms(page, served, control):
    arm_and_set(page)
    page.wait_for_timeout(2500)  # longer than the lease
    assert served.ask("/status")["state"] == "rendering"
    assert control.calls.count(("renew",)) >= 2
    page.goto("about:blank")
    await_state(served, "idle")


def test_refusals_are_shown_with_what_to_do(page, control):
    page.click("#set button")
    text(page, "#refusal-message", "nobody holds a lease; the daemon is idle")
    text(page, "#refusal-hint", "arm first")
    control.arm(60.0)
    page.click("#arm")
    text(page, "#refusal-message", "somebody holds the lease")
    page.click("#refusal-close")
    expect(page.locator("#refusal")).to_be_hidden()


def test_a_fault_is_shown_and_reset(page, served, control):
    arm_and_set(page)
    control.fail("the rig tripped: the monitor reads 1 V")
    text(page, "#state", "FAULT")
    text(page, "#alarm", "Fault: the rig tripped: the monitor reads 1 V. Remove the cause, then reset.")
    expect(page.locator("#events li").first).to_contain_text("the rig tripped")
    page.click("#reset")
    await_state(served, "idle")
    expect(page.locator("#alarm")).to_be_hidden()


def test_a_lost_connection_does_not_look_alive_and_comes_back(page, served):
    arm_and_set(page)
    served.stop()
    try:
        text(page, "#link", "connection lost")
        text(page, "#state", "UNKNOWN")
        text(page, "#output", "UNKNOWN")
        expect(page.locator("#alarm")).to_contain_text("the output may be on")
        page.click("#off")
        expect(page.locator("#refusal-message")).to_contain_text("does not answer")
    finally:
        served.start()
    page.goto(served.url)  # the new daemon has another token
    text(page, "#link", "connected")


def test_silence_on_an_open_connection_is_a_lost_one(page, control):
    text(page, "#state", "IDLE")
    control._lock.acquire()  # the API goes on, but has nothing to say
    try:
        text(page, "#link", "connection lost")
        text(page, "#state", "UNKNOWN")
    finally:
        control._lock.release()
    text(page, "#link", "connected")


def test_off_is_in_sight_and_nothing_overlaps(page):
    for size in ((1280, 800), (1920, 1080), (800, 1200)):
        check_layout(page, *size)


def check_layout(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    box = page.locator("#off").bounding_box()
    assert box["x"] >= 0.0
    assert box["x"] + box["width"] <= width
    assert box["y"] + box["height"] <= height
    boxes = [page.locator("main > section").nth(i).bounding_box() for i in range(7)]
    for i, a in enumerate(boxes):
        assert min(a["width"], a["height"]) > 100.0
        for b in boxes[i + 1 :]:
            apart_x = a["x"] + a["width"] <= b["x"] or b["x"] + b["width"] <= a["x"]
            assert apart_x or a["y"] + a["height"] <= b["y"] or b["y"] + b["height"] <= a["y"]


def luminance(rgb):
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255.0 for v in rgb)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


COLOURS = """(selector) => {
  const numbers = (css) => css.match(/[\\d.]+/g).map(Number);
  const shown = document.querySelector(selector);
  let behind = shown;
  while (behind && numbers(getComputedStyle(behind).backgroundColor)[3] === 0) behind = behind.parentElement;
  return [numbers(getComputedStyle(shown).color), numbers(getComputedStyle(behind).backgroundColor)];
}"""


def test_contrast_is_that_of_wcag_aa(page, control):
    """At least 4.5 for text: WCAG 2.1, success criterion 1.4.3."""
    check_contrast(page, "IDLE")
    page.click("#arm")
    check_contrast(page, "ARMED")
    page.click("#set button")
    check_contrast(page, "RENDERING")
    control.fail("by hand")
    check_contrast(page, "FAULT")


def check_contrast(page, state):
    text(page, "#state", state)
    for selector in ("#state", "#output", "#off", "#simulated", "#link", "#lease", "#arm", "dt", "#events time"):
        ink, paper = (luminance(c[:3]) for c in page.evaluate(COLOURS, selector))
        assert (max(ink, paper) + 0.05) / (min(ink, paper) + 0.05) >= 4.5, selector


def test_the_other_pages_of_a_browser_cannot_use_the_api(browser, served):
    context = browser.new_context()
    page = context.new_page()
    page.goto("about:blank")
    origin = served.url.partition("/page/")[0]
    with pytest.raises(BrowserError, match="Failed to fetch"):
        page.evaluate(f"fetch('{origin}/off', {{method: 'POST', headers: {{Authorization: 'Bearer {served.token}'}}}})")
    context.close()
