"""Textures from names and files: what is read, and what is refused with which words."""

import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import FrictionMap, Grating, Placed, Profile
from haptic_driver.textures.library import (
    load,
    load_texture,
    nameless_files,
    script_names,
    texture_names,
)
from tests.haptic_driver.lab.refusal import refused

TEN = [
    "braille",
    "brushed_metal",
    "fine_grating",
    "grating",
    "linen",
    "ramp",
    "ratchet",
    "ridges",
    "sandpaper",
    "uniform",
]
SHIPPED = [Path(__file__).parents[3] / "configs" / "textures"]
MAP = 'kind = "map"\nfile = "{}"\npitch_mm = 2.0\n'
NOISE = 'kind = "noise"\nmean_cof = 0.6\namplitude_cof = 0.1\n'
GRATING = 'kind = "grating"\nmean_cof = 0.6\n'
FINE = "amplitude_cof = 0.1\nperiod_mm = 1\n"
SCALE = "cof_black = 0.5\ncof_white = 0.7\n"


def write(tmp_path, text, name="texture.toml"):
    (tmp_path / name).write_text(text)
    return load_texture(str(tmp_path / name), SHIPPED)


def error_of(tmp_path, text, name="texture.toml"):
    with pytest.raises(BadInputError) as caught:
        write(tmp_path, text, name)
    assert str(tmp_path / name) in caught.value.message
    return caught.value


def map_of(tmp_path, name, more=SCALE):
    return write(tmp_path, MAP.format(name) + more)


def map_refused(tmp_path, name, more=SCALE):
    error = error_of(tmp_path, MAP.format(name) + more)
    assert f"key 'file': {tmp_path / name}" in error.message
    return error


def grey(values, dtype=np.uint8):
    return Image.fromarray(np.array(values, dtype))


def png(path, width, height, *, bits, colour_type, chunks=()):
    """A PNG written by hand; without `chunks` it has a header and no pixels."""
    header = (b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0))
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in (header, *chunks, (b"IEND", b""))
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)


class TestShipped:
    def test_names(self):
        assert texture_names(SHIPPED) == sorted([*TEN, "steps"])
        assert script_names(SHIPPED) == ["steps"]

    def test_linen_is_tiled_weave_that_uses_its_whole_range(self):
        linen = load_texture("linen", SHIPPED)
        assert isinstance(linen, FrictionMap)
        assert linen.cof.shape == (96, 96)
        assert linen.bounds() == pytest.approx((0.55, 0.70))
        assert linen.cof_at(0.013, 0.007) == pytest.approx(
            linen.cof_at(0.013 - 0.024, 0.007 + 0.048)
        )

    @pytest.mark.parametrize("name", TEN)
    def test_lies_where_the_default_model_reaches_and_says_what_it_is(self, name):
        low, high = load_texture(name, SHIPPED).bounds()
        assert 0.52 <= low <= high <= 0.85
        assert name == "uniform" or high / low >= 1.11**2  # two just noticeable steps
        assert load(name, SHIPPED).description
        assert (SHIPPED[0] / f"{name}.toml").read_text().startswith("# ")


class TestNames:
    def test_unknown_name_gives_the_nearest_and_the_list(self):
        hint = "Did you mean 'linen'? textures: braille, brushed_metal, "
        with refused("unknown_texture", "no texture 'linnen'", hint=hint):
            load_texture("linnen", SHIPPED)

    @pytest.mark.parametrize("name", ["", "..", "a\0b", "uniform\n"])
    def test_odd_names_are_unknown(self, name):
        with refused("unknown_texture"):
            load_texture(name, SHIPPED)

    def test_no_folder_has_no_names(self, tmp_path):
        assert texture_names([tmp_path / "missing"]) == []
        assert script_names([tmp_path / "missing"]) == []
        with pytest.raises(BadInputError, match="no texture 'uniform'"):
            load_texture("uniform", [])

    @pytest.mark.parametrize("name", ["gone/linnen.toml", "linnen.csv", "gone/linnen"])
    def test_missing_file(self, name):
        with refused("file_not_found", "does not exist", hint="'linen'"):
            load_texture(name, SHIPPED)

    @pytest.mark.parametrize("name", ["gone/cloth.png", "cloth.npy"])
    def test_picture_alone_is_told_what_it_lacks_by_an_example_that_works(self, tmp_path, name):
        with pytest.raises(BadInputError) as caught:
            load_texture(name, SHIPPED)
        assert caught.value.code == "texture_needs_scale"
        example = caught.value.hint.split("\n", 1)[1]
        assert len(example.splitlines()) == 5
        grey([[0, 255]]).save(tmp_path / "cloth.png")
        loaded = write(tmp_path, example.replace(Path(name).name, "cloth.png"))
        np.testing.assert_allclose(loaded.cof, [[0.55, 0.70]])

    def test_a_script_is_no_texture(self):
        for name, code in (("steps", "not_a_texture"), ("photo.jpg", "bad_texture")):
            with refused(code):
                load_texture(name, SHIPPED)


class TestDescriptions:
    def test_grating_in_millimetres_and_degrees(self, tmp_path):
        turned = "amplitude_cof = 0.1\nperiod_mm = 8\ndirection_deg = 90\nphase_deg = 180"
        assert write(tmp_path, GRATING + turned) == Grating(0.6, 0.1, 0.008, math.pi / 2, math.pi)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "kind is missing"),
            ('kind = "uniform"\ncof = nan', ": cof"),
            ('kind = "uniform"\ncof = 1' + "0" * 400, ": cof"),
            (GRATING + "amplitude_cof = 0.6\nperiod_mm = 1", "reach 0 to 1.2"),
            (GRATING + "amplitude_cof = 0.1\nperiod_mm = 1\nduty = 0.5", "not to a sine"),
            (GRATING + FINE + 'wave = "square"\nduty = 0.9', "a part of 0.1 mm"),
            ('kind = "map"\nfile = "a.png"\npitch_mm = [1, -1]', ": pitch_mm"),
            (
                'kind = "map"\nfile = "a.png"\npitch_mm = 1\ncof_black = 0.5',
                "cof_black and cof_white go together",
            ),
            (NOISE + "shortest_mm = 2\nlongest_mm = 1", "do not increase"),
            (
                NOISE + "shortest_mm = 0.2\nlongest_mm = 2\ntile_mm = 100",
                "'tile_mm': at most 23.33",
            ),
        ],
    )
    def test_fault_is_named_with_file_and_key(self, tmp_path, text, words):
        error = error_of(tmp_path, text)
        assert error.code == "bad_texture"
        assert words in error.message
        assert error.hint

    @pytest.mark.parametrize("text", ["kind = ", "a = " + "[" * 5000, "a = 1" + "0" * 5000])
    def test_what_is_no_toml_is_refused(self, tmp_path, text):
        error = error_of(tmp_path, text)
        assert error.code == "bad_toml"
        assert str(tmp_path / "texture.toml") in error.message

    def test_unknown_kind_and_key_get_the_nearest_match(self, tmp_path):
        assert "Did you mean 'uniform'?" in error_of(tmp_path, 'kind = "unifrom"\ncof = 0.6').hint
        error = error_of(tmp_path, 'kind = "uniform"\ncof = 0.6\nperiod = 1\ncoff = 0.6')
        assert "unknown key 'coff'" in error.message
        assert "unknown key 'period'" in error.message
        assert "Did you mean 'cof'?" in error.hint


class TestProfiles:
    def test_alone(self, tmp_path):
        profile = write(
            tmp_path,
            "# comment\nposition_m , cof, note\n0.0, 0.5, a\n\n0.1, 0.7, b\n",
            "profile.csv",
        )
        assert profile == Profile([0.0, 0.1], [0.5, 0.7])

    def test_along_another_direction_and_repeated(self, tmp_path):
        (tmp_path / "p.csv").write_text("position_mm,cof\n0,0.5\n10,0.7\n20,0.5\n")
        more = (
            'kind = "profile"\nfile = "p.csv"\ndirection_deg = 90\norigin_mm = [0, 5]\noutside ='
            ' "tile"\n'
        )
        profile = write(tmp_path, more)
        assert profile.cof_at(0.3, 0.010) == pytest.approx(0.6)
        assert profile.cof_at(0.3, 0.015 + 0.040) == pytest.approx(0.7)

    def test_through_toml_with_byte_order_mark_and_windows_lines(self, tmp_path):
        (tmp_path / "p.csv").write_bytes(b"\xef\xbb\xbfcof,position_m\r\n0.5,0.0\r\n0.7,0.1\r\n")
        profile = write(tmp_path, 'kind = "profile"\nfile = "p.csv"')
        assert profile == Profile([0.0, 0.1], [0.5, 0.7])

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("position_m,mu\n0,0.5\n", "column cof is missing; found: position_m, mu"),
            ("position_m,cof\n0,0.5\n", "has 1 points"),
            ("position_m,cof\n0.2,0.5\n\n0.1,0.6\n", "line 4: position_m 0.1"),
            ("position_m,cof\n0,0.5\n1,7\n", "line 3: cof 7"),
        ],
    )
    def test_fault_is_named_with_file_and_line(self, tmp_path, text, words):
        error = error_of(tmp_path, text, "profile.csv")
        assert error.code == ("missing_column" if "missing" in words else "bad_profile")
        assert words in error.message
        assert error.hint

    def test_fault_through_toml_names_both_files(self, tmp_path):
        error = error_of(tmp_path, 'kind = "profile"\nfile = "p.csv"')
        assert error.code == "file_not_found"
        assert f"key 'file': {tmp_path / 'p.csv'} does not exist" in error.message


class TestPictures:
    def test_8_bit_grey(self, tmp_path):
        grey([[0, 51], [102, 255]]).save(tmp_path / "a.png")
        picture = map_of(tmp_path, "a.png")
        np.testing.assert_allclose(picture.cof, [[0.5, 0.54], [0.58, 0.7]])
        assert (picture.pitch_x_m, picture.pitch_y_m) == (0.002, 0.002)
        assert picture.outside == "nothing"

    def test_16_bit_grey(self, tmp_path):
        grey([[0, 13107, 65535]], np.uint16).save(tmp_path / "a.png")
        np.testing.assert_allclose(map_of(tmp_path, "a.png").cof, [[0.5, 0.54, 0.7]])

    def test_pitch_place_and_outside(self, tmp_path):
        grey([[0, 255]]).save(tmp_path / "a.png")
        where = SCALE + 'origin_mm = [10, -20.0]\nrotation_deg = 90\noutside = "tile"\n'
        placed = write(tmp_path, MAP.format("a.png").replace("2.0", "[2.0, 3]") + where)
        assert isinstance(placed, Placed)
        where = (placed.origin_x_m, placed.origin_y_m, placed.rotation_rad)
        assert where == (0.010, -0.020, math.pi / 2)
        picture = placed.texture
        assert (picture.pitch_x_m, picture.pitch_y_m, picture.outside) == (0.002, 0.003, "tile")

    @pytest.mark.parametrize("mode", ["RGBA", "P"])
    def test_grey_saved_as_opaque_colour_is_grey(self, tmp_path, mode):
        grey([[0, 51, 255]]).convert(mode).save(tmp_path / "a.png")
        np.testing.assert_allclose(map_of(tmp_path, "a.png").cof, [[0.5, 0.54, 0.7]])

    def test_colour_is_refused_with_its_place(self, tmp_path):
        grey([[[9, 9, 9], [9, 8, 9]]]).save(tmp_path / "a.png")
        error = map_refused(tmp_path, "a.png")
        assert error.code == "bad_image"
        assert "colour, first at row 0, column 1" in error.message

    def test_transparency_is_refused(self, tmp_path):
        image = grey([[9, 9]]).convert("LA")
        image.putalpha(254)
        image.save(tmp_path / "a.png")
        assert "transparent" in map_refused(tmp_path, "a.png").message

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    def test_transparent_grey_level_is_refused(self, tmp_path, dtype):
        grey([[0, 9]], dtype).save(tmp_path / "a.png", transparency=9)
        assert "transparent" in map_refused(tmp_path, "a.png").message

    def test_16_bit_colour_is_refused_rather_than_read_as_8_bit(self, tmp_path):
        pixels = zlib.compress(b"\0" + struct.pack(">HHH", 700, 700, 700))
        png(tmp_path / "a.png", 1, 1, bits=16, colour_type=2, chunks=[(b"IDAT", pixels)])
        assert "16-bit picture with colour" in map_refused(tmp_path, "a.png").message

    def test_huge_picture_is_refused_before_it_is_unpacked(self, tmp_path):
        png(tmp_path / "a.png", 8001, 8000, bits=8, colour_type=0)
        error = map_refused(tmp_path, "a.png")
        assert error.code == "map_too_large"
        assert "8001 x 8000" in error.message

    def test_other_kinds_of_file_are_refused(self, tmp_path):
        assert "cannot be a '.jpg' file" in error_of(tmp_path, MAP.format("a.jpg") + SCALE).message

    def test_picture_without_scale(self, tmp_path):
        error = error_of(tmp_path, MAP.format("a.png"))
        assert error.code == "texture_needs_scale"
        assert "'cof_black' and 'cof_white'" in error.message


class TestFinePictures:
    """Detail finer than 0.1 mm is averaged: a sliding finger would pick from it by chance."""

    def test_stripes_finer_than_a_finger_can_be_driven_become_their_mean(self, tmp_path):
        Image.fromarray(np.tile(np.array([0, 255], dtype=np.uint8), (4, 100))).save(
            tmp_path / "a.png"
        )
        picture = write(tmp_path, MAP.format("a.png").replace("2.0", "0.01") + SCALE)
        np.testing.assert_allclose(picture.cof, 0.6, atol=1e-12)
        assert picture.pitch_x_m * picture.cof.shape[1] == pytest.approx(200 * 1e-5)
        assert picture.pitch_y_m * picture.cof.shape[0] == pytest.approx(4 * 1e-5)


class TestArrays:
    def test_npy_of_cof(self, tmp_path):
        np.save(tmp_path / "a.npy", np.array([[0.5, 0.6], [0.7, 0.8]], dtype=np.float32))
        np.testing.assert_allclose(
            map_of(tmp_path, "a.npy", "").cof, [[0.5, 0.6], [0.7, 0.8]], rtol=1e-7
        )

    def test_npy_with_scale(self, tmp_path):
        np.save(tmp_path / "a.npy", np.array([[-2e-9, 3e-9]]))
        assert "less its least value, over its range" in map_refused(tmp_path, "a.npy", SCALE).hint
        np.save(tmp_path / "a.npy", np.asfortranarray([[0.0, 0.25, 1.0], [1.0, 0.0, 0.0]]))
        found = map_of(tmp_path, "a.npy").cof
        np.testing.assert_allclose(found, [[0.5, 0.55, 0.7], [0.7, 0.5, 0.5]])

    def test_csv_of_cof_and_with_scale(self, tmp_path):
        (tmp_path / "a.csv").write_text("# corner of a cloth\n0.5, 1.0\n0.25,0.75\n")
        np.testing.assert_allclose(map_of(tmp_path, "a.csv", "").cof, [[0.5, 1.0], [0.25, 0.75]])
        np.testing.assert_allclose(map_of(tmp_path, "a.csv").cof, [[0.6, 0.7], [0.55, 0.65]])

    @pytest.mark.parametrize(
        ("array", "more", "words"),
        [
            ([[0.5, math.nan]], "", "nan at row 0, column 1"),
            ([[0.5, -0.1]], SCALE, "-0.1 at row 0, column 1"),
            (np.zeros((0, 3)), "", "is empty"),
            (np.array([[None]]), "", "not a table"),
        ],
    )
    def test_npy_fault_is_named_with_its_place(self, tmp_path, array, more, words):
        np.save(tmp_path / "a.npy", np.array(array), allow_pickle=True)
        error = map_refused(tmp_path, "a.npy", more)
        assert error.code == "bad_map"
        assert words in error.message

    def test_npy_whose_header_asks_for_all_memory(self, tmp_path):
        np.save(tmp_path / "a.npy", np.zeros((1, 1)))
        path = tmp_path / "a.npy"
        small, large = b"(1, 1), }" + b" " * 20, b"(10000000000, 10000000000), }"
        path.write_bytes(path.read_bytes().replace(small, large))
        assert "more than 4 million" in map_refused(tmp_path, "a.npy").message

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "no rows"),
            ("0.5,0.6\n0.5\n", "unequal length"),
            ("a,b\n0.5,0.6\n", "line 1: 'a' is no number"),
            ("0.5,nan\n", "nan at row 0, column 1"),
        ],
    )
    def test_csv_fault_is_named(self, tmp_path, text, words):
        (tmp_path / "a.csv").write_text(text)
        error = map_refused(tmp_path, "a.csv", "")
        assert error.code == "bad_map"
        assert words in error.message


DAMAGE = st.lists(
    st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=4
)


@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(damage=DAMAGE, keep=st.floats(0, 1), suffix=st.sampled_from(["png", "16.png", "npy", "csv"]))
def test_a_damaged_file_loads_or_is_refused_and_nothing_else(tmp_path, damage, keep, suffix):
    name = f"a.{suffix}"
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16)
    if suffix == "npy":
        np.save(tmp_path / name, grey / 255)
    elif suffix == "csv":
        np.savetxt(tmp_path / name, grey / 255, delimiter=",")
    else:
        Image.fromarray(grey if suffix == "png" else grey.astype(np.uint16) * 257).save(
            tmp_path / name
        )
    content = bytearray((tmp_path / name).read_bytes())
    for place, byte in damage:
        content[int(place**3 * len(content))] = byte  # mostly in the header
    (tmp_path / name).write_bytes(content[: math.ceil(len(content) * min(1.0, 2 * keep))])
    try:
        picture = map_of(tmp_path, name)
    except BadInputError:
        return
    assert np.all((picture.cof >= 0.5 - 1e-12) & (picture.cof <= 0.7 + 1e-12))


def test_a_name_too_long_for_a_file_system_is_unknown(tmp_path):
    """Bug: 200 two-byte characters raised OSError, which the API would have answered with status
    500.
    """
    with pytest.raises(BadInputError, match="no texture"):
        load("ä" * 200, [tmp_path])


def test_one_file_that_cannot_be_read_leaves_the_others_in_the_lists(tmp_path):
    """A name that is no UTF-8, a content that is none, a folder, and a link to nothing."""
    (tmp_path / "even.toml").write_text('kind = "uniform"\ncof = 0.6\n')
    (tmp_path / "caf\udce9.toml").write_text('kind = "uniform"\ncof = 0.6\n')
    (tmp_path / "latin.toml").write_bytes(b'description = "caf\xe9"')
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "gone.toml").symlink_to(tmp_path / "nowhere.toml")
    (tmp_path / "steps.toml").write_text(
        'kind = "script"\n[[step]]\ntime_s = 0\ncof = 0.6\n[[step]]\ntime_s = 1\ncof = 0.6\n'
    )
    assert texture_names([tmp_path]) == ["even", "latin", "steps"]
    assert script_names([tmp_path]) == ["steps"]
    assert nameless_files([tmp_path]) == [f"{tmp_path}/caf\\udce9.toml"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# position_mm,cof\n1,0.5\n2,0.6\n", "its header is commented out, in line 1"),
        ("Rig 3\nposition_mm,cof\n1,0.5\n2,0.6\n", "its header stands in line 2"),
        ("1,0.5\n2,0.6\n", "line 1: holds numbers where the names"),
    ],
)
def test_a_table_whose_header_is_elsewhere_is_told_where(tmp_path, text, said):
    (tmp_path / "mine.csv").write_text(text)
    with pytest.raises(BadInputError, match=said):
        load(str(tmp_path / "mine.csv"), [])
