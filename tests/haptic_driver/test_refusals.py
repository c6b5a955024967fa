"""Refusals that no other test reaches, each by its code where it is decided."""

from __future__ import annotations

import socket
from collections.abc import Callable
from math import nan
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from PIL import Image

from haptic_driver.cli.output import confirm_attended
from haptic_driver.client import HapticClient
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.inquiry import Inquiry
from haptic_driver.daemon.outlets import OscOutlet
from haptic_driver.daemon.private_file import private_folder
from haptic_driver.daemon.scene import polygon
from haptic_driver.errors import HapticError
from haptic_driver.lab.contact.film import read_bare
from haptic_driver.lab.contact.scale import scale_from_ruler
from haptic_driver.lab.findings import investigate
from haptic_driver.lab.importers.image import Picture, friction_shares, read_picture
from haptic_driver.lab.importers.vibration import Vibration, along_the_way
from haptic_driver.lab.psychophysics.data import SessionFiles
from haptic_driver.lab.psychophysics.description import Outside
from haptic_driver.lab.psychophysics.fit import fit
from haptic_driver.lab.psychophysics.outside import OutsideMethod
from haptic_driver.lab.scene_replay import SceneReplay
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.public.commands import command
from haptic_driver.public.given import columns_of, in_si
from haptic_driver.recording.read import Run
from haptic_driver.recording.writer import where
from haptic_driver.render.feedback import FeedbackSettings, checked
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.devices import build_rig
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.amplifiers import AmplifierConfig
from haptic_driver.simulation.finger_function import FingerFunction, load_finger
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.memory import MemoryTransport
from model.support.reading import read_bytes
from model.support.tables import read_table


class Undecided:
    """An optimiser whose answers are no levels."""

    def __init__(self, **about: str) -> None:
        """Of whatever condition."""

    def suggest(self) -> str:
        return "high"


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def lines(folder: Path) -> Path:
    """A picture of lines every 8 pixels one way, and every 16 the other way."""
    y, x = np.mgrid[:256, :256]
    bright = np.sin(2.0 * np.pi * x / 8.0) + np.sin(2.0 * np.pi * y / 16.0)
    Image.fromarray(np.uint8(127.0 + 60.0 * bright)).save(folder / "grid.png")
    return folder / "grid.png"


def two(folder: Path) -> Path:
    """A file of two pictures."""
    one = Image.new("L", (64, 64), 9)
    one.save(folder / "two.tif", save_all=True, append_images=[one])
    return folder / "two.tif"


def of_a_kind_that_is_gone() -> RigConfig:
    """A rig whose generator's package has been taken away since its file was read."""
    config = load_rig("simulated")
    gone = config.waveform_generator.model_copy(update={"model": "gone"})
    return config.model_copy(update={"waveform_generator": gone})


def session_without_json(folder: Path) -> SessionFiles:
    files = SessionFiles(folder, "P1", "01", "made")
    files.beh.mkdir(parents=True)
    files.sidecar.write_text("{")
    return files


def asked_of_a_daemon_that_hangs_up(folder: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "d.sock"))
        listener.listen()

        def hang_up() -> None:
            for _ in range(2):  # the client looks whether anybody is there, and asks then
                listener.accept()[0].close()

        Thread(target=hang_up, daemon=True).start()
        HapticClient(folder / "d.sock").status()


UNDECIDED = Outside(kind="outside", python=f"{__name__}:Undecided")
REFUSED: list[tuple[str, Callable[[Path], object]]] = [
    ("bad_feedback", lambda _: checked(FeedbackSettings(0.0, correlation=2.0))),
    ("bad_function", lambda _: load_finger("json:__name__")),
    ("bad_generator", lambda _: of_a_kind_that_is_gone().generator_kind()),
    ("bad_input", lambda _: in_si("voltage_v", [[1.0], [1.0, 2.0]])),
    ("bad_session", lambda at: session_without_json(at).described()),
    ("bad_shape", lambda _: polygon(10.0, 10.0, [[0.0, 0.0], [5.0, 0.0]])),
    ("bad_suggestion", lambda _: OutsideMethod(UNDECIDED, {}, Path()).suggest()),
    ("command_failed", lambda _: command("texture check linnen")),
    ("file_too_large", lambda at: read_bytes(written(at / "a", "ab"), 1)),
    ("function_failed", lambda _: FingerFunction(lambda *given: "x").friction(*SLIDING)),
    ("function_failed", lambda _: FingerFunction(lambda *given: nan).friction(*SLIDING)),
    ("function_failed", lambda _: FingerFunction(lambda *given: 1.0).friction(*SLIDING, 0.0)),
    ("near_name", lambda _: columns_of({"voltage": [75.0]}, ["voltage_v"])),
    ("near_name", lambda at: read_table(written(at / "a", "voltage\n75\n"), ["voltage_v"], "")),
    ("no_amplifier", lambda _: build_rig(WITHOUT_AMPLIFIER, PORT, None, Wiring())),
    ("no_answer", asked_of_a_daemon_that_hangs_up),
    ("no_contrast", lambda _: friction_shares(GREY, "luminance", 0.0, (2.0, 98.0))),
    ("no_folder", lambda at: private_folder(written(at / "a", "") / "b")),
    ("no_report", lambda _: Inquiry(EventLog()).page()),
    ("no_ruler", lambda at: scale_from_ruler(at / "none.png", 1.0)),
    ("no_scene", lambda _: SceneReplay(Run("run_0001", {}, {}, np.zeros(0, SAMPLE), []))),
    ("not_attended", lambda _: confirm_attended("paper")),
    ("real_rig", lambda _: investigate("paper")),
    ("relative_path", lambda _: where(Path("run.h5"))),
    ("several_pictures", lambda at: read_bare(two(at))),
    ("several_pictures", lambda at: read_picture(two(at), 10.0)),
    ("too_few_rows", lambda _: Inquiry(EventLog()).ask([], "reference", simulated=True)),
    ("too_few_trials", lambda _: fit([0.1], [True], "logistic", 0.5)),
    ("too_short", lambda _: along_the_way(HUM, 0.05, 0.6, 0.1, "hum.wav")),
    ("two_rulers", lambda at: scale_from_ruler(lines(at), 1.0)),
    ("unknown_host", lambda _: OscOutlet("no..host:9000")),
]
SLIDING = (250.0, 75.0, 0.5, 0.02, 0.0)
SIMULATED = load_rig("simulated")
# of a kind that makes no device
UNMADE = AmplifierConfig(**SIMULATED.amplifier.model_dump())
WITHOUT_AMPLIFIER = SIMULATED.model_copy(update={"amplifier": UNMADE})
PORT = MemoryTransport(Simulated33220A())
GREY = Picture(np.full((9, 9), 0.5), 0.1, [])
HUM = Vibration(np.ones(10), 1000.0)


@pytest.mark.parametrize(("code", "refuse"), REFUSED, ids=[code for code, _ in REFUSED])
def test_what_cannot_be_is_refused(code, refuse, tmp_path):
    with pytest.raises(HapticError) as refused:
        refuse(tmp_path)
    assert refused.value.code == code
    assert refused.value.message


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("daemon run --socket http://127.0.0.1:1/?token=a", "no_place"),
        ("calibrate none.csv --also wetnes --out m.toml", "bad_parameter"),
    ],
)
def test_a_command_refuses_before_it_begins(words, code, haptic):
    done = haptic(*words.split(), "--json")
    assert (done.status, done.said["error"]["code"]) == (2, code)
