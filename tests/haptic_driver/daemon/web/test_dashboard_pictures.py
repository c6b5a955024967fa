"""The page as it is seen: where things are, how fine, nothing cut at any width, and contrast by day
and by night.
"""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.messages import InstrumentStatus
from haptic_driver.processes.samples import Flag
from hw.health import Health
from tests.haptic_driver.daemon.web.served_page import arm, expect, opened, press_grey, text
from tests.waiting import until

pytestmark = pytest.mark.process

SCREEN_MM = (100.0, 60.0)
NOTHING = np.array([228.0, 232.0, 237.0])  # --nothing of the light theme
BETWEEN = [pytest.param(*size, marks=pytest.mark.soak) for size in ((768, 1024), (1280, 800))]
SIZES = [(390, 844), *BETWEEN, (1920, 1080)]


@pytest.fixture
def control(one_control):
    """Of one page, which would not follow one that begins anew."""
    return one_control


@pytest.fixture(scope="module")
def one_page(browser, served):
    page = opened(browser, served)
    yield page
    page.context.close()


@pytest.fixture
def page(one_page, control):
    """One page for all, idle and as it was."""
    control.disarm()
    control.flags, control.lifted = [], False
    if control.machine.fault_reason is not None:
        control.reset()
    one_page.set_viewport_size({"width": 1280, "height": 800})
    one_page.emulate_media(color_scheme="light")
    text(one_page, "#state", "IDLE")
    one_page.click("#zoom-fit")
    return one_page


def canvas(page, name):
    """Pixels [y, x, 4] of a canvas."""
    said = page.evaluate(f"document.getElementById('{name}').toDataURL()")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(said.partition(",")[2]))), dtype=float)


def screen(page, name):
    """The part of a canvas that shows the screen."""
    inside, box = page.locator("#marks").bounding_box(), page.locator(f"#{name}").bounding_box()
    x, y = round(inside["x"] - box["x"]), round(inside["y"] - box["y"])
    return canvas(page, name)[y : y + round(inside["height"]), x : x + round(inside["width"])]


def brightness(pixels):
    """Grows with friction: the scale goes from dark to light. Sum of the channels."""
    return pixels[..., :3].sum(axis=-1)


def shown(page, name):
    """The screen with this texture on it, complete."""
    page.check(f"#textures input[value={name}]", force=True)
    expect(page.locator("#shown")).to_contain_text(name)

    def whole():
        pixels = screen(page, "texture-map")
        missing = np.abs(pixels[..., :3] - NOTHING).max(axis=-1) < 3.0
        return None if missing.any() else [pixels]

    return until(whole)[0]


def correlation(a, b):
    return np.corrcoef(a.ravel(), b.ravel())[0, 1]


def test_braille_lies_as_in_its_file(page):
    """Origin upper left, y down: dots where the picture has them, and not where its mirror images
    have.
    """
    path = next(found for folder in texture_dirs() if (found := folder / "braille.png").is_file())
    file = np.asarray(Image.open(path).convert("L"), dtype=float)
    picture = brightness(shown(page, "braille"))
    rows, columns = picture.shape
    pitch_mm = 0.2  # of braille.toml, which repeats
    y = ((np.arange(rows) + 0.5) * SCREEN_MM[1] / rows / pitch_mm).astype(int) % file.shape[0]
    x = ((np.arange(columns) + 0.5) * SCREEN_MM[0] / columns / pitch_mm).astype(int) % file.shape[1]
    expected = file[np.ix_(y, x)]
    assert correlation(picture, expected) > 0.9
    for mirrored in (expected[::-1], expected[:, ::-1], expected[::-1, ::-1]):
        assert correlation(picture, mirrored) < 0.5


def test_the_trail_has_the_colour_of_measured_friction(page):
    """The finger goes round, 20 mm around 30, 30 mm, and friction grows with y."""
    shown(page, "linen")
    inside = page.locator("#marks").bounding_box()

    def whole_turn():
        pixels = canvas(page, "trail")
        coloured = (pixels[..., 3] > 250) & (np.ptp(pixels[..., :3], axis=-1) > 60)
        rows = np.nonzero(coloured)[0]
        return (
            None
            if not rows.size or np.ptp(rows) < 0.6 * inside["height"]
            else (pixels, coloured, rows)
        )

    pixels, coloured, rows = until(whole_turn)
    light = brightness(pixels)
    upper, lower = rows.min() + 4, rows.max() - 4
    assert light[:upper][coloured[:upper]].mean() + 100.0 < light[lower:][coloured[lower:]].mean()
    box, pixels_per_mm = page.locator("#trail").bounding_box(), inside["width"] / SCREEN_MM[0]
    assert box["y"] - inside["y"] == pytest.approx(
        10.0 * pixels_per_mm, abs=8.0
    )  # half of its width, and an edge
    assert box["x"] - inside["x"] == pytest.approx(10.0 * pixels_per_mm, abs=8.0)


def has_colour(page, variable):
    wanted = page.evaluate(COLOUR_OF, variable)
    return bool((np.abs(canvas(page, "friction")[..., :3] - wanted).max(axis=-1) < 2.0).any())


COLOUR_OF = """(name) => {
  const probe = document.createElement("span");
  probe.style.color = `var(${name})`;
  document.body.append(probe);
  const found = getComputedStyle(probe).color.match(/[\\d.]+/g).map(Number);
  probe.remove();
  return found.slice(0, 3);
}"""


def test_reach_tolerance_and_gaps_are_shaded(page, control):
    arm(page)
    page.fill("#cof", "0.65")
    page.click("#set button")
    page.locator("#friction").scroll_into_view_if_needed()
    until(lambda: has_colour(page, "--reach") and has_colour(page, "--five"))
    control.lifted = True
    until(lambda: has_colour(page, "--gap"))


CUT = """() => {
  const wide = document.documentElement.clientWidth, found = [];
  if (document.documentElement.scrollWidth > wide) found.push(`page ${document.documentElement.scrollWidth}`);
  for (const one of document.querySelectorAll("header *, #alarm, main *")) {
    const box = one.getBoundingClientRect();
    if (!box.width || one.closest("#marks") || one.closest("option")) continue;
    const name = `${one.tagName} ${one.id} ${one.className}`;
    if (box.left < -0.5 || box.right > wide + 0.5) found.push(`${name} outside`);
    const scrolls = ["INPUT", "SELECT", "CANVAS"].includes(one.tagName) || one.id === "events";
    if (!scrolls && one.clientWidth && one.scrollWidth > one.clientWidth + 1)
      found.push(`${name} too wide`);
    if (one.tagName === "SECTION" && one.scrollHeight > one.clientHeight + 1) found.push(`${name} too high`);
  }
  return found;
}"""


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_nothing_is_cut_with_all_flags_and_a_refusal(page, control, width, height):
    page.set_viewport_size({"width": width, "height": height})
    control.flags = Flag(2**32 - 1).names()
    tracker = Health("finger_tracker", asked=12_000, missed=345, heard_s=99.997, took_s=2.3e-5)
    reporting = {"every_s": 5.1e-3, "jitter_s": 1.2e-3}
    control.instruments = [InstrumentStatus.of(tracker, 100.0).model_copy(update=reporting)]
    expect(page.locator("#flags li")).to_have_count(len(control.flags))  # then nothing moves
    expect(page.locator("#instruments tr")).to_have_count(2)
    press_grey(page, "#set button")
    expect(page.locator("#refusal")).to_be_visible()
    assert page.evaluate(CUT) == []
    for button in ("#disarm", "#set button", "#play button", "#record button"):
        page.locator(button).evaluate("(one) => one.scrollIntoView({ block: 'center' })")
        expect(page.locator(button)).to_be_in_viewport(ratio=1.0)
        expect(page.locator("#off")).to_be_in_viewport(ratio=1.0)
    boxes = page.evaluate("""() => [...document.querySelectorAll("main > section")].slice(0, 6)
      .map((one) => one.getBoundingClientRect().toJSON())""")  # at one moment
    for i, a in enumerate(boxes):
        assert min(a["width"], a["height"]) > 100.0
        for b in boxes[i + 1 :]:
            apart_x = a["x"] + a["width"] <= b["x"] or b["x"] + b["width"] <= a["x"]
            assert apart_x or a["y"] + a["height"] <= b["y"] or b["y"] + b["height"] <= a["y"]
    areas = {
        name: canvas(page, name)[..., 0].size for name in ("texture-map", "friction", "surface")
    }
    assert max(areas, key=areas.__getitem__) != "surface"
    page.click("#refusal-close")


def luminance(rgb):
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (v / 255.0 for v in rgb)
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


COLOURS = """() => {
  const numbers = (css) => css.match(/[\\d.]+/g).map(Number);
  const found = [];
  for (const one of document.querySelectorAll("header *, #alarm, main *")) {
    const words = [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!words || !one.getClientRects().length || one.tagName === "OPTION") continue;
    let behind = one;
    while (behind && numbers(getComputedStyle(behind).backgroundColor)[3] === 0) behind = behind.parentElement;
    const paper = behind ? getComputedStyle(behind).backgroundColor : "rgb(255, 255, 255)";
    found.push([`${one.tagName} ${one.id} ${one.className}`, numbers(getComputedStyle(one).color), numbers(paper)]);
  }
  return found;
}"""


def check_contrast(page, state):
    """At least 4.5 for every text: WCAG 2.1, success criterion 1.4.3."""
    text(page, "#state", state)
    found = page.evaluate(COLOURS)
    assert len(found) > 50
    for name, ink, paper in found:
        light, dark = sorted((luminance(ink[:3]), luminance(paper[:3])), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (name, ink, paper)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_is_that_of_wcag_aa(page, control, scheme):
    page.emulate_media(color_scheme=scheme)
    background = luminance(page.evaluate(COLOUR_OF, "--back"))
    assert (background > 0.5) is (scheme == "light")
    control.flags = ["overrun"]
    press_grey(page, "#set button")
    check_contrast(page, "IDLE")
    page.click("#refusal-close")
    arm(page)
    check_contrast(page, "ARMED")
    page.click("#set button")
    check_contrast(page, "RENDERING")
    control.fail("by hand")
    check_contrast(page, "FAULT")


def test_the_screen_is_moved_by_keys(page):
    shown(page, "linen")
    page.focus("#finger")
    before = canvas(page, "texture-map")
    page.keyboard.press("+")
    expect(page.locator("#shown")).to_contain_text("zoom 2")
    until(lambda: not np.array_equal(canvas(page, "texture-map"), before))
    zoomed = canvas(page, "texture-map")
    page.keyboard.press("ArrowRight")
    assert not np.array_equal(canvas(page, "texture-map"), zoomed)
    page.keyboard.press("0")
    expect(page.locator("#shown")).not_to_contain_text("zoom")
