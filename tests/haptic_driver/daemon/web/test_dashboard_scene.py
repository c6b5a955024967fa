"""A scene on the page: its objects where they are, and one that is dragged while armed."""

import pytest

from haptic_driver.daemon.verbs import SceneChange
from tests.haptic_driver.daemon.web.served_page import arm, expect, text
from tests.waiting import until

pytestmark = pytest.mark.process

OBJECTS = SceneChange.model_validate(
    {
        "changes": [
            {"do": "background", "cof": 0.55},
            {
                "do": "add",
                "id": "key",
                "shape": {"kind": "circle", "radius_mm": 8.0},
                "origin_mm": [30.0, 20.0],
                "texture": "linen",
            },
            {
                "do": "add",
                "id": "bar",
                "shape": {"kind": "rectangle", "width_mm": 20.0, "height_mm": 6.0},
                "origin_mm": [70.0, 40.0],
                "rotation_deg": 90.0,
                "cof": 0.8,
            },
        ]
    }
).changes
A_PIXEL_MM = 0.3  # of the page's, at the map's scale


@pytest.fixture
def held(page, control):
    """Armed on the page, with the scene there."""
    arm(page)
    token = control.machine._lease.token
    control.change_scene(token, OBJECTS)
    expect(page.locator("#objects g")).to_have_count(2)
    control.calls.clear()
    return page


def place_of(page, x_mm, y_mm):
    """Where on the page a place of the screen is."""
    box = page.locator("#marks").bounding_box()
    return box["x"] + x_mm / 100.0 * box["width"], box["y"] + y_mm / 60.0 * box["height"]


def at(control, name):
    return next(each.origin_mm for each in control.scene.object if each.id == name)


def dragged(page, start, end, steps=20):
    page.mouse.move(*place_of(page, *start))
    page.mouse.down()
    page.mouse.move(*place_of(page, *end), steps=steps)
    page.mouse.up()


def test_objects_lie_where_they_are_felt(held):
    for name, x_mm, y_mm in (("key", 30.0, 20.0), ("bar", 70.0, 40.0)):
        box = until(held.locator(f"#objects g[data-id={name}] > :first-child").bounding_box)
        middle = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
        assert middle == pytest.approx(place_of(held, x_mm, y_mm), abs=3.0)  # lines and shadow
    assert box["height"] > 2.0 * box["width"]  # turned by 90 degrees
    assert held.complaints == []


def test_an_object_is_dragged_while_armed(held, control):
    dragged(held, (32.0, 21.0), (52.0, 31.0))
    until(lambda: at(control, "key") == pytest.approx([50.0, 30.0], abs=A_PIXEL_MM))
    moved = [call for call in control.calls if call[0] == "change_scene"]
    assert len(moved) > 1  # while it was dragged, not only at the end
    assert at(control, "bar") == [70.0, 40.0]
    text(held, "#state", "RENDERING")


def test_the_keyboard_moves_an_object_too(held, control):
    held.focus("#finger")
    held.keyboard.press("n")
    held.keyboard.press("n")
    expect(held.locator("#objects g.selected")).to_have_attribute("data-id", "bar")
    held.keyboard.press("Shift+ArrowRight")
    until(lambda: at(control, "bar") == [71.0, 40.0])


def test_nobody_drags_without_the_lease(held, control):
    held.click("#disarm")
    text(held, "#state", "IDLE")
    control.calls.clear()
    dragged(held, (30.0, 20.0), (50.0, 30.0))
    assert [call for call in control.calls if call[0] == "change_scene"] == []
    assert at(control, "key") == [30.0, 20.0]
