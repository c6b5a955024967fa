"""A scene by command line and by Python, as the daemon hears of it."""

import json

import pytest

from haptic_driver.cli.main import main
from haptic_driver.client import HapticClient, circle
from haptic_driver.daemon.address import Address
from haptic_driver.daemon.private_file import write_private
from haptic_driver.textures.objects import Circle, Rectangle
from tests.haptic_driver.daemon.bench_control import BenchControl, serving


@pytest.fixture
def control(tmp_path, monkeypatch):
    bench = BenchControl()
    with serving(bench, tmp_path):
        monkeypatch.setenv("HAPTIC_SOCKET", str(tmp_path / "d.sock"))
        yield bench


def test_the_command_line_changes_the_scene(control, tmp_path, capsys):
    lease = control.arm(60.0)
    write_private(Address.of(tmp_path / "d.sock").lease_file, lease.token)

    def haptic(words):
        return main(["scene", *words.split()])

    assert haptic("add key 0.7 --circle 30 20 8") == 0
    assert haptic("add bar linen --rounded 60 40 20 8 2 --turn 30 --soft-edge 1 --order 2") == 0
    assert main(["scene", "add", "tri", "0.6", "--polygon", "80,10 90,10 80,25"]) == 0
    assert haptic("move key -4 25") == 0
    assert haptic("turn bar -45") == 0
    assert haptic("set key --of 0.65 --disabled") == 0
    key, bar, tri = control.scene.object
    assert (key.origin_mm, key.cof, key.enabled) == ([-4.0, 25.0], 0.65, False)
    assert (bar.texture, bar.rotation_deg, bar.order, bar.soft_edge_mm) == ("linen", -45.0, 2, 1.0)
    assert bar.shape == Rectangle(width_mm=20.0, height_mm=8.0, radius_mm=2.0)
    assert tri.origin_mm == [85.0, 17.5]
    moves = [{"do": "move", "id": "bar", "x_mm": 50, "y_mm": 41}, {"do": "remove", "id": "tri"}]
    (tmp_path / "moves.json").write_text(json.dumps(moves))
    assert main(["scene", "change", str(tmp_path / "moves.json")]) == 0
    capsys.readouterr()
    assert haptic("list") == 0
    assert "bar: rectangle at 50, 41 mm, linen" in capsys.readouterr().out
    assert haptic("move bat 1 1") == 2
    assert "there is no object 'bat'" in capsys.readouterr().err
    assert haptic("add x 0.6") == 2
    assert haptic("background") == 0
    assert haptic("clear") == 0
    assert (control.scene.object, control.scene.background.cof) == ([], None)


def test_python_changes_several_at_once_and_nothing_of_a_block_that_fails(control):
    with HapticClient() as client, client.armed(60.0) as rig:
        rig.scene.add("key", circle(30.0, 20.0, 8.0), 0.7)
        with (  # noqa: PT012 - a block that fails is what is tested
            pytest.raises(ZeroDivisionError),
            rig.scene.together() as block,
        ):
            block.move("key", 40.0, 20.0)
            raise ZeroDivisionError
        assert rig.scene.described.object[0].origin_mm == [30.0, 20.0]
        with rig.scene.together() as block:
            block.turn("key", 10.0)
            block.set("key", 0.65, Circle(radius_mm=5.0), soft_edge_mm=1.0)
        (key,) = control.scene.object
        assert (key.rotation_deg, key.cof, key.soft_edge_mm) == (10.0, 0.65, 1.0)
        assert key.shape == Circle(radius_mm=5.0)
        rig.scene.remove("key")
        assert control.scene.object == []
