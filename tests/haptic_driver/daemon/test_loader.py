"""What is read for a client is bounded: bombs, pipes and devices are refused, and control never
reads them itself.
"""

import os
import signal
import struct
import threading
import time
import zlib
from pathlib import Path

import pytest

from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Uniform
from haptic_driver.textures.tile import Grid
from tests.waiting import until

pytestmark = pytest.mark.process

REACHABLE_COF = (0.5, 1.0)
MAP = 'kind = "map"\nfile = "{}"\npitch_mm = 1.0\ncof_black = 0.5\ncof_white = 0.7\n'
PROFILE = 'kind = "profile"\nfile = "{}"\n'
HJIF = 'kind = "hjif"\nfile = "{}"\ncof_low = 0.5\ncof_high = 0.7\n'
SCRIPT = 'kind = "script"\nfile = "{}"\n'
MOST_BYTES = 100 << 20
MIB = 1 << 20


@pytest.fixture(scope="module")
def running():
    loader = Loader()
    loader.texture("linen", REACHABLE_COF)
    yield loader
    loader.close()


@pytest.fixture
def loader(running):
    """One that is there, whatever the test before did to it; its peak counts from now."""
    running.texture("linen", REACHABLE_COF)
    Path(f"/proc/{running.pids['loader']}/clear_refs").write_text("5")
    return running


@pytest.fixture
def usual_bytes(loader):
    """What it has before; libraries that earlier files made it load stay with it."""
    return peak_bytes(loader)


def peak_bytes(loader):
    said = Path(f"/proc/{loader.pids['loader']}/status").read_text()
    return int(said.split("VmHWM:")[1].split()[0]) * 1024


def chunk(name, content):
    return (
        struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
    )


def header(width, height, bits=8, colour=0):
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0))


def data(content):
    return chunk(b"IDAT", content)


def png(*chunks):
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks) + chunk(b"IEND", b"")


def squeezed(size):
    """That many zeros; what a MiB of them becomes after the first is the same again and again."""
    stream, zeros, times = zlib.compressobj(9), bytes(MIB), size // MIB
    first, again = (stream.compress(zeros) + stream.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    checksum = (size % 65521 << 16) + 1  # Adler-32 of zeros
    return first + again * (times - 1) + b"\x03\0" + struct.pack(">I", checksum)


def test_what_is_squeezed_is_as_large_as_it_says():
    assert zlib.decompress(squeezed(3 * MIB)) == bytes(3 * MIB)


def npy(text, content=b""):
    text = text.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def npy_of(shape, descr="<f8"):
    return npy(f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}")


def hjif(**given):
    frames = [{"relative_position": i, "amplitude_modulation": 0.1 + 0.1 * i} for i in range(3)]
    unit = given.get("unit_exponent", -3)
    return (
        f'{{"perceptions": [{{"id": 0, "perception_modality": "Friction", "unit_exponent": {unit},'
        f' "channels": [{{"gain": {given.get("gain", 1)}, "bands": [{{"band_type": "Curve",'
        ' "effects": [{"keyframes":'
        f" {str(given.get('frames', frames)).replace(chr(39), chr(34))}}}]}}]}}]}}]}}"
    ).encode()


def coloured():
    return zlib.compress((b"\0" + b"\1\2\3" * 2000) * 2000)


FILES = {  # made when they are asked for
    "png_wide": (MAP, "a.png", lambda: png(header(60_000, 60_000), data(squeezed(MIB)))),
    "png_of_5_million": (MAP, "a.png", lambda: png(header(2500, 2000), data(squeezed(5 * MIB)))),
    "png_second_header": (
        MAP,
        "a.png",
        lambda: png(header(1, 1), header(13_000, 13_000), data(squeezed(170 * MIB))),
    ),
    "png_second_header_largest": (
        MAP,
        "a.png",
        lambda: png(header(1, 1), header(10**5, 10**5), data(squeezed(MIB))),
    ),
    "png_long_data": (
        MAP,
        "a.png",
        lambda: png(header(2000, 2000), data(b"x" + squeezed(900 * MIB))),
    ),
    "png_text": (
        MAP,
        "a.png",
        lambda: png(header(1, 1), chunk(b"zTXt", b"a\0\0" + squeezed(900 * MIB))),
    ),
    "png_many_texts": (
        MAP,
        "a.png",
        lambda: png(header(1, 1), *[chunk(b"zTXt", b"a\0\0" + squeezed(MIB))] * 900),
    ),
    "png_profile": (
        MAP,
        "a.png",
        lambda: png(header(1, 1), chunk(b"iCCP", b"a\0\0" + squeezed(900 * MIB))),
    ),
    "png_all_coloured": (MAP, "a.png", lambda: png(header(2000, 2000, colour=2), data(coloured()))),
    "png_large": (MAP, "a.png", lambda: bytes(40 * MIB)),
    "npy_shape": (MAP, "a.npy", lambda: npy_of("(1000000, 1000000)")),
    "npy_shape_small_type": (MAP, "a.npy", lambda: npy_of("(100000, 100000)", "|b1")),
    "npy_empty_type": (MAP, "a.npy", lambda: npy_of("(1000000000, 1000000000)", "|V0")),
    "npy_many_dimensions": (MAP, "a.npy", lambda: npy_of("(" + "9," * 20 + ")")),
    "npy_object": (MAP, "a.npy", lambda: npy_of("(2, 2)", "|O")),
    "npy_negative": (MAP, "a.npy", lambda: npy_of("(-1000000, -1000000)")),
    "npy_deep_header": (MAP, "a.npy", lambda: npy("(" * 90 + ")" * 9)),
    "npy_large": (MAP, "a.npy", lambda: npy_of("(2, 2)") + bytes(40 * MIB)),
    "csv_rows": (PROFILE, "a.csv", lambda: b"position_mm,cof\n" + b"1,1\n" * 500_000),
    "csv_4_million_rows": (PROFILE, "a.csv", lambda: b"position_mm,cof\n" + b"1,1\n" * 4_000_000),
    "csv_columns": (PROFILE, "a.csv", lambda: b"position_mm,cof" + b",a" * 1_000_000),
    "csv_one_field": (PROFILE, "a.csv", lambda: b"position_mm,cof\n1," + b"1" * 2_000_000),
    "csv_steps": (SCRIPT, "a.csv", lambda: b"time_s,cof\n" + b"1,1\n" * 600_000),
    "csv_grid": (MAP, "a.csv", lambda: b"1,2\n" * (700 << 10)),
    "csv_grid_one_row": (MAP, "a.csv", lambda: b"12," * 1_000_000 + b"x"),
    "csv_grid_long": (MAP, "a.csv", lambda: b"0.5\n" * (2 * MIB)),
    "hjif_exponent": (HJIF, "a.hjif", lambda: hjif(unit_exponent=100_000_000)),
    "hjif_exponent_small": (HJIF, "a.hjif", lambda: hjif(unit_exponent=-100_000_000)),
    "hjif_exponent_long_curve": (HJIF, "a.hjif", lambda: hjif(unit_exponent=8)),
    "hjif_long_number": (HJIF, "a.hjif", lambda: hjif(gain="9" * 100_000)),
    "hjif_infinite": (HJIF, "a.hjif", lambda: hjif(gain="1e999")),
    "hjif_deep": (HJIF, "a.hjif", lambda: b"[" * (MIB - 9)),
    "hjif_large": (HJIF, "a.hjif", lambda: hjif(frames="[" + "{}," * 300_000 + "{}]")),
}

DESCRIPTIONS = {
    "toml_deep": "a = " + "[" * 500_000,
    "toml_deep_inline": "a = " + "{a=" * 150_000,
    "toml_dotted_key": "a." * 250_000 + "a = 1",
    "toml_dotted_header": "[" + "a." * 250_000 + "a]",
    "toml_dotted_quoted": '"a" . ' * 80_000 + "a = 1",
    "toml_long_number": "a = " + "9" * 500_000,
    "toml_large": "# " + "x" * 4_000_000,
    "toml_many_keys": "\n".join(f"k{i} = 1" for i in range(35_000)),
    "noise": (
        'kind = "noise"\nmean_cof = 0.6\namplitude_cof = 0.1\nshortest_mm = 0.2\nlongest_mm ='
        " 2\ntile_mm = 10000"
    ),
}


def refused(loader, path, usual_bytes):
    """The refusal of a texture, and how much larger than usual the process became."""
    pid = loader.pids["loader"]
    with pytest.raises(BadInputError) as error:
        loader.texture(str(path), REACHABLE_COF)
    assert loader.pids == {"loader": pid}, f"it died of it: {error.value.message}"
    return error.value, peak_bytes(loader) - usual_bytes


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_a_bomb_is_refused_in_little_memory(loader, usual_bytes, tmp_path, name):
    described, file, make = FILES[name]
    (tmp_path / file).write_bytes(make())
    (tmp_path / "texture.toml").write_text(described.format(file))
    error, grown_bytes = refused(loader, tmp_path / "texture.toml", usual_bytes)
    assert error.code != "too_much"
    assert str(tmp_path) in error.message
    assert grown_bytes < MOST_BYTES


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_a_description_that_is_a_bomb_is_refused_in_little_memory(
    loader, usual_bytes, tmp_path, name
):
    (tmp_path / "texture.toml").write_text(DESCRIPTIONS[name])
    error, grown_bytes = refused(loader, tmp_path / "texture.toml", usual_bytes)
    assert error.code != "too_much"
    assert grown_bytes < MOST_BYTES
    with pytest.raises(BadInputError):
        loader.model(str(tmp_path / "texture.toml"))


@pytest.mark.parametrize("file", ["a.png", "a.npy", "a.csv", "a.hjif"])
@pytest.mark.parametrize(
    "make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")], ids=["pipe", "device"]
)
def test_what_is_no_regular_file_is_refused_and_never_waited_for(loader, tmp_path, file, make):
    """A pipe behind a texture's name once held the daemon's API for ever, and /dev/zero ate the
    memory.
    """
    at_first_bytes = peak_bytes(loader)  # what earlier tests made it allocate stays with it
    make(tmp_path / file)
    described = {".csv": PROFILE, ".hjif": HJIF}.get(Path(file).suffix, MAP)
    (tmp_path / "texture.toml").write_text(described.format(file))
    error, grown_bytes = refused(loader, tmp_path / "texture.toml", at_first_bytes)
    assert "is a pipe or a device" in error.message
    assert grown_bytes < 10 * MIB


def test_a_model_behind_a_pipe_is_refused(loader, tmp_path):
    os.mkfifo(tmp_path / "finger.toml")
    with pytest.raises(BadInputError):
        loader.model(str(tmp_path / "finger.toml"))


def fill(name, size):
    return bytes(size)


def test_its_memory_is_bounded_and_it_is_there_again(loader):
    """Whatever gets past the readers."""
    before = loader.pids
    with pytest.raises(BadInputError, match="more than 5 s of a processor or 256 MiB") as refusal:
        loader._ask(fill, "a large one", 300 * MIB)
    assert refusal.value.code == "too_much"
    target, asked, *_ = loader.texture("linen", REACHABLE_COF)
    assert asked.cof_low < asked.cof_high
    assert target.bounds() == (asked.cof_low, asked.cof_high)
    assert loader.pids != before


def test_one_that_hangs_is_ended(loader, monkeypatch):
    os.kill(loader.pids["loader"], signal.SIGSTOP)
    with monkeypatch.context() as hurry:
        hurry.setattr("haptic_driver.daemon.loader.HANG_S", 0.5)
        with pytest.raises(BadInputError, match=r"was not read within 0\.5 s"):
            loader.texture("linen", REACHABLE_COF)
    assert loader.texture("linen", REACHABLE_COF)[1].cof_low > 0.0


def busy(name):
    while True:
        pass


def test_what_takes_too_long_is_ended_by_the_time_of_a_processor(loader, monkeypatch):
    """A ramp was refused for 5 s by the clock, beside others that had the processors."""
    with monkeypatch.context() as hurry:
        hurry.setattr("haptic_driver.daemon.loader.TIME_S", 0.5)
        with pytest.raises(BadInputError, match="takes more than"):
            loader._ask(busy, "a long one")
        loader._ask(time.sleep, 1.0)  # it waits for longer than it may compute
    assert loader.texture("linen", REACHABLE_COF)[1].cof_low > 0.0


def test_who_comes_meanwhile_is_told_and_does_not_wait(loader):
    pid = loader.pids["loader"]
    os.kill(pid, signal.SIGSTOP)
    found = []
    first = threading.Thread(target=lambda: found.append(loader.texture("linen", REACHABLE_COF)))
    first.start()
    until(loader._lock.locked)
    with pytest.raises(RefusedError, match="something else is being loaded") as refused:
        loader.texture("linen", REACHABLE_COF)
    assert refused.value.code == "loading"
    os.kill(pid, signal.SIGCONT)
    first.join()
    assert found[0][1].cof_low > 0.0


def test_a_friction_by_file_is_what_it_says(loader, tmp_path):
    (tmp_path / "texture.toml").write_text('kind = "uniform"\ncof = 0.6')
    target, asked, *_ = loader.texture(str(tmp_path / "texture.toml"), (0.7, 1.0))
    assert target == Uniform(0.6)
    assert (asked.share_below, asked.share_above) == (1.0, 0.0)


def test_it_has_no_precedence_and_ends_with_control(loader):
    pid = loader.pids["loader"]
    assert os.getpriority(os.PRIO_PROCESS, pid) == 19
    child = loader._child
    loader._link.close()  # as the end of control's process does
    until(lambda: child.ended)


def test_pictures_are_of_the_library_alone(running, tmp_path):
    low, high, levels = running.tile("braille", Grid(0.0, 0.0, 1e-3, 30, 20))
    assert (low, high, len(levels)) == (
        pytest.approx(0.55, abs=0.01),
        pytest.approx(0.8, abs=0.01),
        600,
    )
    own = tmp_path / "own.toml"
    own.write_text('kind = "uniform"\ncof = 0.6\n')
    for name in (str(own), "../textures/linen", "linnen", "linen.toml"):
        with pytest.raises(BadInputError, match="in the library"):
            running.tile(name, Grid(0.0, 0.0, 1e-3, 3, 2))
    with pytest.raises(BadInputError, match="not a texture"):
        running.tile("steps", Grid(0.0, 0.0, 1e-3, 3, 2))
