"""Who moves 200 objects 60 times a second: a client in Python, or a page in a browser by the
shipped `haptic.js`; not a test.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from benchmarks.scene import RATE_HZ, moved, objects
from haptic_driver.client import HapticClient, LeaseLostError
from haptic_driver.daemon.messages import RefusedError

LEASE_S = 5.0


class InPython:
    """Sends a change whenever one is due and the last is answered."""

    def __init__(self, session):
        self._session = session
        self.token = session.token

    def moved_until(self, is_over):
        """Move until `is_over`, asked now and then, or the lease is lost; what each change took."""
        took_s, start_s = [], time.monotonic()
        with suppress(RefusedError):
            while len(took_s) % round(RATE_HZ) or not is_over():
                now_s = time.monotonic()
                self._session.scene.change(moved(now_s))
                took_s.append(time.monotonic() - now_s)
                time.sleep(max(start_s + len(took_s) / RATE_HZ - time.monotonic(), 0.0))
        return took_s


@contextmanager
def in_python(client: HapticClient, page: str) -> Iterator[InPython]:
    with suppress(LeaseLostError), client.armed(LEASE_S) as session:
        session.scene.change([*objects()])
        yield InPython(session)


class InABrowser:
    """Says where all are whenever the page is drawn; places that come meanwhile go together."""

    def __init__(self, view, token):
        self._view = view
        self.token = token

    def moved_until(self, is_over):
        """Move until `is_over`, asked each second, or the lease is lost; what each change took."""
        self._view.evaluate("begin()")
        while not is_over() and self._view.evaluate("lost") is None:
            time.sleep(1.0)
        return self._view.evaluate("took_s")


# Each object on a circle about where it was put.
SCRIPT = """async (made) => {
  const { Haptic } = await import("./haptic.js");
  const haptic = await Haptic.open();
  Object.assign(window, { lost: null, took_s: [] });
  haptic.lost = (error) => { window.lost = String(error); };
  const lease = await haptic.arm(%s);
  await haptic.scene(made, true);
  haptic.scene = async (...asked) => {
    const began = performance.now();
    await Haptic.prototype.scene.apply(haptic, asked);
    window.took_s.push((performance.now() - began) / 1000);
  };
  const objects = made.filter(({ id }) => id); // not the background
  window.begin = () => {
    const frame = (now) => {
      const x_mm = 2 * Math.cos(0.0005 * now), y_mm = 2 * Math.sin(0.0005 * now);
      for (const { id, origin_mm: [home_x_mm, home_y_mm] } of objects)
        haptic.move(id, home_x_mm + x_mm, home_y_mm + y_mm);
      if (window.lost === null) requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  };
  return lease.token;
}"""


@contextmanager
def in_a_browser(client: HapticClient, page: str) -> Iterator[InABrowser]:
    from playwright.sync_api import sync_playwright

    from tests.haptic_driver.daemon.web.served_page import CHROMIUM

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        view = browser.new_page()
        view.goto(page)  # which keeps the token
        view.goto(page.replace("/page/", "/page/widgets.html"))
        yield InABrowser(view, view.evaluate(SCRIPT % LEASE_S, [*objects()]))
        browser.close()
