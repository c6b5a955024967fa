"""The example of an app's own page, in a real browser: what is drawn and what is felt move together."""

import socket
from pathlib import Path

import pytest

from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.run import PAGE_FOLDER
from tests.haptic_driver.daemon.web.served_page import (
    HANG_MS,
    BrowserError,
    Served,
    SlidingControl,
    expect,
)
from tests.waiting import until

pytestmark = pytest.mark.process


@pytest.fixture
def page(browser, served, control):
    context = browser.new_context(viewport={"width": 1000, "height": 700})
    page = context.new_page()
    page.set_default_timeout(HANG_MS)
    page.goto(served.url.replace("/page/", "/page/widgets.html"))
    page.click("#arm")
    expect(page.locator("#said")).to_have_text("armed")
    yield page
    context.close()


def made(control, name):
    (found,) = (each for each in control.scene.object if each.id == name)
    return found


def to(page, x_mm, y_mm):
    """The pointer, at a place of the screen: 10 pixels are 1 mm."""
    box = page.locator("#screen").bounding_box()
    page.mouse.move(box["x"] + 10.0 * x_mm, box["y"] + 10.0 * y_mm, steps=5)


def test_a_slider_stops_at_its_detents(page, control):
    assert made(control, "thumb").origin_mm[0] == 50.0
    to(page, 50.0, 12.0)
    page.mouse.down()
    to(page, 78.0, 12.0)
    page.mouse.up()
    assert page.locator("#level").text_content() == "7"
    until(lambda: made(control, "thumb").origin_mm[0] == 80.0)


def test_a_button_feels_otherwise_while_it_is_pressed(page, control):
    released = made(control, "key").cof
    to(page, 22.0, 38.0)
    page.mouse.down()
    until(lambda: made(control, "key").cof > released)
    page.mouse.up()
    until(lambda: made(control, "key").cof == released)


def test_a_list_goes_on_after_it_is_let_go(page, control):
    to(page, 70.0, 55.0)
    page.mouse.down()
    to(page, 70.0, 40.0)
    page.mouse.up()
    let_go = len(control.calls)
    until(lambda: sum(call[0] == "change_scene" for call in control.calls[let_go:]) > 5)


def test_off_is_there_and_leaving_is_off(page, control):
    assert control.machine.state is DaemonState.RENDERING
    page.keyboard.press("Escape")
    expect(page.locator("#said")).to_have_text("off")
    assert control.machine.state is DaemonState.IDLE
    page.click("#arm")
    expect(page.locator("#said")).to_have_text("armed")
    page.goto("about:blank")
    until(lambda: control.machine.state is DaemonState.IDLE)


def test_two_hundred_objects_that_a_page_moves_as_often_as_it_draws(page, control):
    """Each answer is waited for; places that came meanwhile go together with the next."""
    page.click("#off")
    expect(page.locator("#said")).to_have_text("off")
    moved = page.evaluate(
        """async () => {
      const { Haptic } = await import("./haptic.js");
      const haptic = await Haptic.open(), circle = { kind: "circle", radius_mm: 3 };
      await haptic.arm();
      const objects = Array.from({ length: 200 }, (_, k) => `object ${k}`);
      await haptic.scene(
        objects.map((id) => ({ do: "add", id, cof: 0.6, shape: circle, origin_mm: [10, 10] })), true);
      let frames = 0;
      haptic.lost = (error) => { frames = String(error); };
      await new Promise((done) => {
        const frame = () => {
          objects.forEach((id, k) => haptic.move(id, 10 + (k % 20), 10 + frames));
          if (++frames === 30) done();
          else requestAnimationFrame(frame);
        };
        frame();
      });
      return frames;
    }"""
    )
    assert moved == 30
    until(lambda: made(control, "object 7").origin_mm == [17.0, 39.0])


def test_the_recipe_for_an_apps_own_page(browser, served, control):
    recipes = (Path(__file__).parents[4] / "docs" / "recipes.md").read_text()
    code = recipes.partition("```javascript\n")[2].partition("```")[0]
    base = served.url.partition("/page/")[0]
    code = code.replace("http://127.0.0.1:8470", base).replace("TOKEN", served.token)
    context = browser.new_context(bypass_csp=True)
    page = context.new_page()
    page.goto(base + "/page/widgets.html")
    page.add_script_tag(content=code, type="module")
    until(lambda: control.scene is not None and control.scene.object)

    def follows():
        """Once the page listens, which it does after it has heard that the knob is there."""
        page.mouse.move(340.0, 120.0)
        page.mouse.move(350.0, 120.0)
        return made(control, "knob").origin_mm == [35.0, 12.0]

    until(follows)
    context.close()


def said(page, script):
    """What it gives, on a page with a channel of its own."""
    return page.evaluate(
        f"""async () => {{
      const {{ Haptic }} = await import("./haptic.js");
      const haptic = await Haptic.open();
      {script}
    }}"""
    )


def test_a_verb_that_is_not_there_is_refused(page):
    code = said(
        page,
        """const refused = haptic.ask("nosuch").catch((error) => error.code);
      await haptic.ask("status"); // which is answered after it
      return Promise.race([refused, "no answer"]);""",
    )
    assert code == "not_found"


def test_who_holds_a_lease_hears_that_the_daemon_has_gone_and_others_do_not(browser, tmp_path):
    """A page of which no renewal was on its way rendered on the screen alone."""
    served = Served(SlidingControl(), tmp_path)
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(served.url.replace("/page/", "/page/widgets.html"))
        said(
            page,
            """window.heard = [];
      const opened = { holder: haptic, idle: await Haptic.open(), disarmed: await Haptic.open() };
      for (const [who, one] of Object.entries(opened)) one.lost = ({ message }) => heard.push([who, message]);
      window.allClosed = Promise.all(Object.values(opened).map(
        ({ socket }) => new Promise((closed) => socket.addEventListener("close", closed))));
      await opened.disarmed.arm();
      await opened.disarmed.disarm();
      await haptic.arm(60); // renewed every 15 s
      window.holder = haptic;""",
        )
        served.stop()
        page.evaluate("allClosed")
        gone = [["holder", "the daemon has gone"]]
        assert page.evaluate("heard") == gone
        page.evaluate("""holder.move("key", 1, 1)""")  # as often as the page draws
        assert page.evaluate("heard") == gone


def test_a_renewal_that_is_on_its_way_as_the_connection_closes_is_told_once(page):
    heard = said(
        page,
        """await haptic.ask("disarm"); // the example's lease
      await haptic.arm();
      const heard = [];
      haptic.lost = ({ message }) => heard.push(message);
      await new Promise((sent) => { haptic.socket.send = sent; }); // a renewal, never answered
      haptic.socket.onclose(); // as a browser calls it
      await new Promise((done) => setTimeout(done));
      return heard;""",
    )
    assert heard == ["the daemon has gone"]


def test_a_page_that_closes_its_channel_itself_has_lost_nothing(page):
    heard = said(
        page,
        """await haptic.ask("disarm");
      await haptic.arm();
      let heard = 0;
      haptic.lost = () => heard++;
      const closed = new Promise((done) => haptic.socket.addEventListener("close", done));
      haptic.close();
      await closed;
      return heard;""",
    )
    assert heard == 0


def test_the_example_opens_another_channel_where_its_own_has_closed(page):
    page.evaluate(
        """() => { // the next that is opened is closed again
      const open = WebSocket.prototype.send;
      WebSocket.prototype.send = function (said) {
        WebSocket.prototype.send = open;
        open.call(this, said);
        window.closing = new Promise((done) => this.addEventListener("close", done));
        this.close();
      };
    }"""
    )
    page.keyboard.press("Escape")
    page.evaluate("closing")
    page.click("#arm")
    expect(page.locator("#said")).to_have_text("armed")


def test_a_wrong_token_is_not_said_to_be_no_daemon_alone(page, served):
    """The server had answered 403, which a browser's WebSocket does not see."""
    why = page.evaluate(
        """async (address) => {
      const { Haptic } = await import("./haptic.js");
      return Haptic.open(address).then(() => "opened", (error) => error.message);
    }""",
        served.url.replace(served.token, "wrong"),
    )
    host = served.url.split("/")[2]
    assert why == (f"no daemon answers at {host}, or it refused the token or this page's address")


OPEN = """async ([source, address]) => {
  const later = setTimeout;
  window.setTimeout = (work, ms) => later(work, ms / 50);
  const { Haptic } = await import("data:text/javascript," + encodeURIComponent(source));
  await Haptic.open(address);
}"""


def test_a_port_that_takes_a_connection_and_answers_nothing_is_no_daemon(browser):
    source = (PAGE_FOLDER / "haptic.js").read_text(encoding="utf-8")
    with socket.create_server(("127.0.0.1", 0)) as silent, browser.new_context() as context:
        address = f"http://127.0.0.1:{silent.getsockname()[1]}/page/?token=x"
        with pytest.raises(BrowserError, match="no daemon answers at"):
            context.new_page().evaluate(OPEN, [source, address])
