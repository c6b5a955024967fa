"""A kind of one's own, in any role, is one package: nothing here knows it, and everything does.

A waveform generator of one's own is `tests/outside_generator`.
"""

from __future__ import annotations

import datetime
import json
import re
import sys
from pathlib import Path

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.rig.check import Check, CheckStatus, Examination
from haptic_driver.rig.claims import Claims
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.devices import Assembly
from haptic_driver.rig.doctor import examinations
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.roles import APART, ROLES, KindRole, RigParts
from hw import plugins
from tests.haptic_driver.config_texts import CONFIGS, changed
from tests.haptic_driver.rig.test_outside_kinds import install

TEMPLATE = (CONFIGS / "rigs" / "template.toml").read_text(encoding="utf-8")
NOBODY = TEMPLATE.replace("192.168.0.5::5025", "127.0.0.1::9")
KINDS = {key: role for key, role in ROLES.items() if isinstance(role, KindRole)}
PACKAGE = """
from typing import Literal
from haptic_driver.rig.part import Part
from {module} import {base}

class Device:
    def __init__(self, resource):
        self.resource, self.log = resource, []

    def open(self):
        self.log.append("opened")

    def close(self):
        self.log.append("closed")

class Kind({base}):
    files = ("table",)
    kind: Literal["lab"]
    device: str
    table: str = ""

    def examine(self, at):
        yield at.ok(f"{{self.device}} answers")

    def make(self, wiring):
        device = Device(self.device)
        return Part(device, [device.open], [device.close])

    def range_hz(self, card_hz):
        return 1.0, 8e3
"""
TODAY = datetime.date(2025, 6, 1)
SAID = {"kind": "lab", "device": "LAB::7", "table": "table.csv"}
NEEDED = {
    "camera": {"scale_m_per_pixel": 2e-5},
    "load_stage": {"higher_presses": True, "clear_m": 0.0, "when_wrong": "retract"},
}


@pytest.fixture(params=KINDS)
def key(request, tmp_path, monkeypatch):
    """A role of which a kind is installed, by a package outside."""
    role, annotation = KINDS[request.param], RigParts.model_fields[request.param].annotation
    base = re.findall(r"[\w.]+", str(annotation).replace("NoneType", ""))
    module, _, name = [n for n in base if n.startswith("haptic_driver")][-1].rpartition(".")
    install(
        tmp_path,
        "lab_kind",
        PACKAGE.format(module=module, base=name),
        f"[{role.group}]\nlab = lab_kind:Kind\n",
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lab_kind", raising=False)
    for cached in (plugins.installed, plugins.load):
        cached.cache_clear()
    yield request.param
    for cached in (plugins.installed, plugins.load):
        cached.cache_clear()


def rig_of(key: str, folder: Path, **said: object) -> RigConfig:
    """A real rig whose file names the kind, with what the template says for its other keys."""
    before = load_rig("template").sections_of(key)
    annotation = str(RigParts.model_fields[key].annotation)
    kept = before[0].model_dump() if before else {}
    known = KINDS[key]["lab"].model_fields
    section = NEEDED.get(key, {}) | {k: v for k, v in kept.items() if k in known} | SAID | said
    lines = [f"{k} = {json.dumps(v)}" for k, v in section.items() if is_toml(v)]
    header = f"[[{key}]]" if "list[" in annotation else f"[{key}]"
    pattern = rf"^\[+{key}\]+.*?(?=^\[)"
    text = re.sub(pattern, "", NOBODY, flags=re.MULTILINE | re.DOTALL)
    path = folder / "lab.toml"
    path.write_text("\n".join([text, header, *lines]), encoding="utf-8")
    return load_rig(str(path))


def is_toml(value: object) -> bool:
    return value is not None and not isinstance(value, datetime.date)


def test_a_kind_from_outside_is_read_claimed_examined_made_and_closed(key, tmp_path):
    rig = rig_of(key, tmp_path)
    (section,) = rig.sections_of(key)
    assert section.table == str(tmp_path / "table.csv")  # a listed section's too
    assert "LAB::7" in rig.addresses
    listed = [(name, one) for name, one in examinations(rig) if name.startswith(KINDS[key].name)]
    ((name, examine),) = [found for found in listed if found[1] == section.examine]
    assert [*examine(Examination(name, rig, TODAY))] == [
        Check(name, CheckStatus.OK, "LAB::7 answers")
    ]
    if ROLES[key].opens is APART:
        device = section.make(Wiring()).device
        assert device.resource == "LAB::7"
        return
    made = Assembly(rig, {key}, ["LAB::7"])
    device = made.one(key)
    for step in (*made.opening(), *made.closing):
        step()
    assert device.log == ["opened", "closed"]
    free = Claims(["LAB::7"])
    free.take()
    free.release()


def test_its_keys_are_named_with_the_nearest(key, tmp_path):
    with pytest.raises(BadInputError, match=f"unknown key '{key}.*tabel'") as refused:
        rig_of(key, tmp_path, tabel="x")
    assert "table" in refused.value.hint


def test_two_roles_never_share_a_port(key, tmp_path):
    other = "interlock" if key != "interlock" else "stage"
    taken = load_rig("template").sections_of(other)[0].addresses[0]
    with pytest.raises(BadInputError, match="each needs a port of its own"):
        rig_of(key, tmp_path, device=taken)


def test_rigs_on_different_ports_exclude_each_other_by_no_line(tmp_path):
    """`line = "rts"` was once taken for an address."""
    box = TEMPLATE[TEMPLATE.index("[interlock]") : TEMPLATE.index("[watchdog]")]
    for word in ("signal", "line"):
        said = f'kind = "modem_line"\nport = "/dev/ttyUSB9"\n{word} = "rts"\nlooped_back = true\n'
        path = tmp_path / "rig.toml"
        path.write_text(changed(TEMPLATE, (box, f"[interlock]\n{said}")), encoding="utf-8")
        assert load_rig(str(path)).addresses_of("interlock") == ["/dev/ttyUSB9"]


def test_a_camera_is_claimed(tmp_path):
    camera = {"kind": "genicam", "producer": "a.cti", "serial": "7", "scale_m_per_pixel": 2e-5}
    rig = RigConfig.model_validate(load_rig("template").model_dump() | {"camera": camera})
    assert "camera:7" in rig.addresses
