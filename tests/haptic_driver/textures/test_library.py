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
from haptic_driver.render.texture import FrictionMap, Grating, Placed, Profile, Uniform
from haptic_driver.textures.library import (
    load,
    load_texture,
    nameless_files,
    script_names,
    texture_names,
)

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
SCALE = "cof_black = 0.5\ncof_white = 0.7\n"


@pytest.fixture
def folder(tmp_path):
    return tmp_path


def write(folder, text, name="texture.toml"):
    (folder / name).write_text(text)
    return load_texture(str(folder / name), SHIPPED)


def refused(folder, text, name="texture.toml"):
    with pytest.raises(BadInputError) as caught:
        write(folder, text, name)
    assert str(folder / name) in caught.value.message
    return caught.value


def map_of(folder, name, more=SCALE):
    return write(folder, MAP.format(name) + more)


def map_refused(folder, name, more=SCALE):
    error = refused(folder, MAP.format(name) + more)
    assert f"key 'file': {folder / name}" in error.message
    return error


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

    def test_ramp(self):
        ramp = load_texture("ramp", SHIPPED)
        assert ramp.cof_at(0.040, 0.0) == pytest.approx(0.625)
        assert math.isnan(ramp.cof_at(0.081, 0.0))

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
        with pytest.raises(BadInputError, match="no texture 'linnen'") as caught:
            load_texture("linnen", SHIPPED)
        assert caught.value.code == "unknown_texture"
        assert caught.value.hint.startswith(
            "Did you mean 'linen'? textures: braille, brushed_metal, "
        )

    @pytest.mark.parametrize("name", ["", ".", "..", "a\0b", "uniform\n", "zzzz"])
    def test_odd_names_are_unknown(self, name):
        with pytest.raises(BadInputError) as caught:
            load_texture(name, SHIPPED)
        assert caught.value.code == "unknown_texture"

    def test_no_folder_has_no_names(self, folder):
        assert texture_names([folder / "missing"]) == []
        assert script_names([folder / "missing"]) == []
        with pytest.raises(BadInputError, match="no texture 'uniform'"):
            load_texture("uniform", [])

    def test_first_folder_wins(self, folder):
        (folder / "uniform.toml").write_text('kind = "uniform"\ncof = 0.9\n')
        assert load_texture("uniform", [folder, *SHIPPED]) == Uniform(0.9)
        assert load_texture("uniform", [*SHIPPED, folder]) == Uniform(0.6)

    def test_name_may_contain_a_dot(self, folder):
        (folder / "silk.v2.toml").write_text('kind = "uniform"\ncof = 0.9\n')
        assert load_texture("silk.v2", [folder]) == Uniform(0.9)

    @pytest.mark.parametrize(
        "name", ["gone/linnen.toml", "linnen.toml", "gone/linnen.csv", "gone/linnen"]
    )
    def test_missing_file(self, name):
        with pytest.raises(BadInputError, match="does not exist") as caught:
            load_texture(name, SHIPPED)
        assert caught.value.code == "file_not_found"
        assert "'linen'" in caught.value.hint

    @pytest.mark.parametrize("name", ["gone/cloth.png", "cloth.PNG", "cloth.npy"])
    def test_picture_alone_is_told_what_it_lacks_by_an_example_that_works(self, folder, name):
        with pytest.raises(BadInputError) as caught:
            load_texture(name, SHIPPED)
        assert caught.value.code == "texture_needs_scale"
        example = caught.value.hint.split("\n", 1)[1]
        assert len(example.splitlines()) == 5
        Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).save(folder / "cloth.png")
        loaded = write(folder, example.replace(Path(name).name, "cloth.png"))
        np.testing.assert_allclose(loaded.cof, [[0.55, 0.70]])

    def test_mpeg_file_alone_is_told_what_it_lacks(self):
        with pytest.raises(BadInputError, match="which friction it means") as caught:
            load_texture("effect.hjif", SHIPPED)
        assert 'kind = "hjif"' in caught.value.hint

    def test_a_script_is_no_texture(self):
        with pytest.raises(BadInputError) as caught:
            load_texture("steps", SHIPPED)
        assert caught.value.code == "not_a_texture"

    def test_other_endings_are_no_textures(self):
        with pytest.raises(BadInputError, match=r"photo\.jpg is not a texture file"):
            load_texture("photo.jpg", SHIPPED)


class TestDescriptions:
    def test_grating_in_millimetres_and_degrees(self, folder):
        text = (
            'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 8\ndirection_deg ='
            " 90\nphase_deg = 180"
        )
        assert write(folder, text) == Grating(0.6, 0.1, 0.008, math.pi / 2, math.pi)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "kind is missing"),
            ("kind = 3", "kind is '3'"),
            ('kind = "uniform"', "cof is missing"),
            ('kind = "uniform"\ncof = 0.001', ": cof"),
            ('kind = "uniform"\ncof = nan', ": cof"),
            ('kind = "uniform"\ncof = "0.6"', ": cof"),
            ('kind = "uniform"\ncof = 1' + "0" * 400, ": cof"),
            ('kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 0', ": period_mm"),
            (
                'kind = "grating"\nmean_cof = 0.6\namplitude_cof = -0.1\nperiod_mm = 1',
                ": amplitude_cof",
            ),
            (
                'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.6\nperiod_mm = 1',
                "reach 0 to 1.2",
            ),
            ('kind = "profile"', "file is missing"),
            ('kind = "map"\nfile = "a.png"', "pitch_mm is missing"),
            ('kind = "map"\nfile = "a.png"\npitch_mm = 0', ": pitch_mm"),
            ('kind = "map"\nfile = "a.png"\npitch_mm = [1, -1]', ": pitch_mm"),
            ('kind = "map"\nfile = "a.png"\npitch_mm = 1\norigin_mm = [1, nan]', ": origin_mm"),
            (
                'kind = "map"\nfile = "a.png"\npitch_mm = 1\ncof_black = 0.5',
                "cof_black and cof_white go together",
            ),
            (
                'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 0.19',
                ": period_mm",
            ),
            (
                'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 1\nduty = 0.5',
                "not to a sine",
            ),
            (
                (
                    'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 1\nwave ='
                    ' "square"\nduty = 0.9'
                ),
                "a part of 0.1 mm",
            ),
            (
                (
                    'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 1\nwave ='
                    ' "round"'
                ),
                ": wave",
            ),
            (NOISE + "shortest_mm = 2\nlongest_mm = 1", "do not increase"),
            (NOISE + "shortest_mm = 1\nlongest_mm = 20", "do not increase"),
            (
                NOISE + "shortest_mm = 0.2\nlongest_mm = 2\ntile_mm = 100",
                "'tile_mm': at most 23.33",
            ),
            (NOISE + "shortest_mm = 1\nlongest_mm = 2\nseed = -1", ": seed"),
            ('kind = "hjif"\nfile = "a.hjif"', "cof_low is missing"),
        ],
    )
    def test_fault_is_named_with_file_and_key(self, folder, text, words):
        error = refused(folder, text)
        assert error.code == "bad_texture"
        assert words in error.message
        assert error.hint

    @pytest.mark.parametrize("text", ["kind = ", "a = " + "[" * 5000, "a = 1" + "0" * 5000])
    def test_what_is_no_toml_is_refused(self, folder, text):
        error = refused(folder, text)
        assert error.code == "bad_toml"
        assert str(folder / "texture.toml") in error.message

    def test_unknown_kind_and_key_get_the_nearest_match(self, folder):
        assert "Did you mean 'uniform'?" in refused(folder, 'kind = "unifrom"\ncof = 0.6').hint
        error = refused(folder, 'kind = "uniform"\ncof = 0.6\nperiod = 1\ncoff = 0.6')
        assert "unknown key 'coff'" in error.message
        assert "unknown key 'period'" in error.message
        assert "Did you mean 'cof'?" in error.hint

    def test_a_folder_is_no_texture(self, folder):
        (folder / "texture.toml").mkdir()
        with pytest.raises(BadInputError):
            load_texture(str(folder / "texture.toml"), SHIPPED)


class TestProfiles:
    def test_alone(self, folder):
        profile = write(
            folder, "# comment\nposition_m , cof, note\n0.0, 0.5, a\n\n0.1, 0.7, b\n", "profile.csv"
        )
        assert profile == Profile([0.0, 0.1], [0.5, 0.7])

    def test_positions_in_millimetres(self, folder):
        profile = write(folder, "position_mm,cof\n0,0.5\n40,0.6\n100,0.7\n", "profile.csv")
        assert profile.position_m == pytest.approx((0.0, 0.04, 0.1))
        assert profile.cof_at(0.07, 0.0) == pytest.approx(0.65)

    def test_along_another_direction_and_repeated(self, folder):
        (folder / "p.csv").write_text("position_mm,cof\n0,0.5\n10,0.7\n20,0.5\n")
        more = (
            'kind = "profile"\nfile = "p.csv"\ndirection_deg = 90\norigin_mm = [0, 5]\noutside ='
            ' "tile"\n'
        )
        profile = write(folder, more)
        assert profile.cof_at(0.3, 0.010) == pytest.approx(0.6)
        assert profile.cof_at(0.3, 0.015 + 0.040) == pytest.approx(0.7)

    def test_through_toml_with_byte_order_mark_and_windows_lines(self, folder):
        (folder / "p.csv").write_bytes(b"\xef\xbb\xbfcof,position_m\r\n0.5,0.0\r\n0.7,0.1\r\n")
        assert write(folder, 'kind = "profile"\nfile = "p.csv"') == Profile([0.0, 0.1], [0.5, 0.7])

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("position_m,mu\n0,0.5\n", "column cof is missing; found: position_m, mu"),
            ("along,cof\n0,0.5\n", "column position_m is missing; found: along, cof"),
            ("position_m,cof\n", "has 0 points"),
            ("position_m,cof\n0,0.5\n", "has 1 points"),
            ("position_m,cof\n0,0.5\n0,0.6\n", "line 3: position_m 0"),
            ("position_m,cof\n0.2,0.5\n\n0.1,0.6\n", "line 4: position_m 0.1"),
            ("position_m,cof\n0,0.5\n1,7\n", "line 3: cof 7"),
        ],
    )
    def test_fault_is_named_with_file_and_line(self, folder, text, words):
        error = refused(folder, text, "profile.csv")
        codes = {
            "missing": "missing_column",
            "not a number": "not_a_number",
        }
        assert error.code == next(
            (code for said, code in codes.items() if said in words), "bad_profile"
        )
        assert words in error.message
        assert error.hint

    def test_fault_through_toml_names_both_files(self, folder):
        error = refused(folder, 'kind = "profile"\nfile = "p.csv"')
        assert error.code == "file_not_found"
        assert f"key 'file': {folder / 'p.csv'} does not exist" in error.message


class TestPictures:
    def test_8_bit_grey(self, folder):
        Image.fromarray(np.array([[0, 51], [102, 255]], dtype=np.uint8)).save(folder / "a.png")
        picture = map_of(folder, "a.png")
        np.testing.assert_allclose(picture.cof, [[0.5, 0.54], [0.58, 0.7]])
        assert (picture.pitch_x_m, picture.pitch_y_m) == (0.002, 0.002)
        assert picture.outside == "nothing"

    def test_16_bit_grey(self, folder):
        Image.fromarray(np.array([[0, 13107, 65535]], dtype=np.uint16)).save(folder / "a.png")
        np.testing.assert_allclose(map_of(folder, "a.png").cof, [[0.5, 0.54, 0.7]])

    def test_1_bit(self, folder):
        Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).convert("1").save(folder / "a.png")
        np.testing.assert_allclose(map_of(folder, "a.png").cof, [[0.5, 0.7]])

    def test_black_may_be_the_higher_friction(self, folder):
        Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).save(folder / "a.png")
        np.testing.assert_allclose(
            map_of(folder, "a.png", "cof_black = 0.7\ncof_white = 0.5\n").cof, [[0.7, 0.5]]
        )

    def test_pitch_place_and_outside(self, folder):
        Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).save(folder / "a.png")
        where = SCALE + 'origin_mm = [10, -20.0]\nrotation_deg = 90\noutside = "tile"\n'
        placed = write(folder, MAP.format("a.png").replace("2.0", "[2.0, 3]") + where)
        assert isinstance(placed, Placed)
        assert (placed.origin_x_m, placed.origin_y_m, placed.rotation_rad) == (
            0.010,
            -0.020,
            math.pi / 2,
        )
        picture = placed.texture
        assert (picture.pitch_x_m, picture.pitch_y_m, picture.outside) == (0.002, 0.003, "tile")

    @pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "P"])
    def test_grey_saved_as_opaque_colour_is_grey(self, folder, mode):
        Image.fromarray(np.array([[0, 51, 255]], dtype=np.uint8)).convert(mode).save(
            folder / "a.png"
        )
        np.testing.assert_allclose(map_of(folder, "a.png").cof, [[0.5, 0.54, 0.7]])

    def test_colour_is_refused_with_its_place(self, folder):
        Image.fromarray(np.array([[[9, 9, 9], [9, 8, 9]]], dtype=np.uint8)).save(folder / "a.png")
        error = map_refused(folder, "a.png")
        assert error.code == "bad_image"
        assert "colour, first at row 0, column 1" in error.message

    @pytest.mark.parametrize("mode", ["LA", "RGBA"])
    def test_transparency_is_refused(self, folder, mode):
        image = Image.fromarray(np.array([[9, 9]], dtype=np.uint8)).convert(mode)
        image.putalpha(254)
        image.save(folder / "a.png")
        assert "transparent" in map_refused(folder, "a.png").message

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    def test_transparent_grey_level_is_refused(self, folder, dtype):
        Image.fromarray(np.array([[0, 9]], dtype=dtype)).save(folder / "a.png", transparency=9)
        assert "transparent" in map_refused(folder, "a.png").message

    def test_16_bit_colour_is_refused_rather_than_read_as_8_bit(self, folder):
        pixels = zlib.compress(b"\0" + struct.pack(">HHH", 700, 700, 700))
        png(folder / "a.png", 1, 1, bits=16, colour_type=2, chunks=[(b"IDAT", pixels)])
        assert "16-bit picture with colour" in map_refused(folder, "a.png").message

    def test_huge_picture_is_refused_before_it_is_unpacked(self, folder):
        png(folder / "a.png", 8001, 8000, bits=8, colour_type=0)
        error = map_refused(folder, "a.png")
        assert error.code == "map_too_large"
        assert "8001 x 8000" in error.message

    def test_empty_picture(self, folder):
        png(folder / "a.png", 0, 5, bits=8, colour_type=0)
        assert "is empty" in map_refused(folder, "a.png").message

    @pytest.mark.parametrize(
        "content", [b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0 a photo", b"GIF89a" + b"0" * 40]
    )
    def test_something_else_is_no_png(self, folder, content):
        (folder / "a.png").write_bytes(content)
        error = map_refused(folder, "a.png")
        assert error.code == "bad_image"
        assert "not a PNG" in error.message

    def test_picture_cut_off_is_damaged(self, folder):
        content = (SHIPPED[0] / "linen.png").read_bytes()
        (folder / "a.png").write_bytes(content[: len(content) // 2])
        assert "is damaged" in map_refused(folder, "a.png").message

    def test_missing_picture(self, folder):
        assert map_refused(folder, "a.png").code == "file_not_found"

    def test_picture_without_scale(self, folder):
        error = refused(folder, MAP.format("a.png"))
        assert error.code == "texture_needs_scale"
        assert "'cof_black' and 'cof_white'" in error.message

    def test_other_kinds_of_file_are_refused(self, folder):
        assert "cannot be a '.jpg' file" in refused(folder, MAP.format("a.jpg") + SCALE).message


class TestFinePictures:
    """Detail finer than 0.1 mm is averaged: a sliding finger would pick from it by chance."""

    def test_stripes_finer_than_a_finger_can_be_driven_become_their_mean(self, folder):
        Image.fromarray(np.tile(np.array([0, 255], dtype=np.uint8), (4, 100))).save(
            folder / "a.png"
        )
        picture = write(folder, MAP.format("a.png").replace("2.0", "0.01") + SCALE)
        np.testing.assert_allclose(picture.cof, 0.6, atol=1e-12)
        assert picture.pitch_x_m * picture.cof.shape[1] == pytest.approx(200 * 1e-5)
        assert picture.pitch_y_m * picture.cof.shape[0] == pytest.approx(4 * 1e-5)

    def test_stripes_that_a_finger_can_be_driven_by_stay(self, folder):
        Image.fromarray(np.tile(np.array([0, 255], dtype=np.uint8), (4, 3))).save(folder / "a.png")
        picture = write(folder, MAP.format("a.png").replace("2.0", "0.1") + SCALE)
        np.testing.assert_allclose(picture.cof, np.tile([0.5, 0.7], (4, 3)))


class TestArrays:
    def test_npy_of_cof(self, folder):
        np.save(folder / "a.npy", np.array([[0.5, 0.6], [0.7, 0.8]], dtype=np.float32))
        np.testing.assert_allclose(
            map_of(folder, "a.npy", "").cof, [[0.5, 0.6], [0.7, 0.8]], rtol=1e-7
        )

    def test_npy_with_scale(self, folder):
        np.save(folder / "a.npy", np.array([[-2e-9, 3e-9]]))
        assert "less its least value, over its range" in map_refused(folder, "a.npy", SCALE).hint
        np.save(folder / "a.npy", np.asfortranarray([[0.0, 0.25, 1.0], [1.0, 0.0, 0.0]]))
        np.testing.assert_allclose(map_of(folder, "a.npy").cof, [[0.5, 0.55, 0.7], [0.7, 0.5, 0.5]])

    def test_csv_of_cof_and_with_scale(self, folder):
        (folder / "a.csv").write_text("# corner of a cloth\n0.5, 1.0\n0.25,0.75\n")
        np.testing.assert_allclose(map_of(folder, "a.csv", "").cof, [[0.5, 1.0], [0.25, 0.75]])
        np.testing.assert_allclose(map_of(folder, "a.csv").cof, [[0.6, 0.7], [0.55, 0.65]])

    @pytest.mark.parametrize(
        ("array", "more", "words"),
        [
            ([[0.5, math.nan]], "", "nan at row 0, column 1"),
            ([[0.5], [6.0]], "", "6 at row 1, column 0"),
            ([[0.5, -0.1]], SCALE, "-0.1 at row 0, column 1"),
            ([[0, 255]], SCALE, "255 at row 0, column 1"),
            ([0.5, 0.6], "", "not a table"),
            ([[0.5j]], "", "not a table"),
            ([["a"]], "", "not a table"),
            (np.zeros((0, 3)), "", "is empty"),
            (np.array([[None]]), "", "not a table"),
        ],
    )
    def test_npy_fault_is_named_with_its_place(self, folder, array, more, words):
        np.save(folder / "a.npy", np.array(array), allow_pickle=True)
        error = map_refused(folder, "a.npy", more)
        assert error.code == "bad_map"
        assert words in error.message

    def test_npy_whose_header_asks_for_all_memory(self, folder):
        np.save(folder / "a.npy", np.zeros((1, 1)))
        content = (
            (folder / "a.npy")
            .read_bytes()
            .replace(b"(1, 1), }" + b" " * 20, b"(10000000000, 10000000000), }")
        )
        (folder / "a.npy").write_bytes(content)
        assert "more than 4 million" in map_refused(folder, "a.npy").message

    @pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"\x93NUMPY", b"\x80\x04."])
    def test_something_else_is_no_array(self, folder, content):
        (folder / "a.npy").write_bytes(content)
        error = map_refused(folder, "a.npy")
        assert error.code == "bad_map"
        assert "not a numpy array" in error.message

    def test_npz_under_another_name(self, folder):
        np.savez(folder / "a.npz", np.ones((2, 2)))
        (folder / "a.npz").rename(folder / "a.npy")
        assert "not a numpy array" in map_refused(folder, "a.npy").message

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "no rows"),
            ("0.5,0.6\n0.5\n", "unequal length"),
            ("a,b\n0.5,0.6\n", "line 1: 'a' is no number"),
            ("0.5,\n", "line 1: '' is no number"),
            ("0.5,nan\n", "nan at row 0, column 1"),
        ],
    )
    def test_csv_fault_is_named(self, folder, text, words):
        (folder / "a.csv").write_text(text)
        error = map_refused(folder, "a.csv", "")
        assert error.code == "bad_map"
        assert words in error.message


DAMAGE = st.lists(
    st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=4
)


@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(damage=DAMAGE, keep=st.floats(0, 1), suffix=st.sampled_from(["png", "16.png", "npy", "csv"]))
def test_a_damaged_file_loads_or_is_refused_and_nothing_else(folder, damage, keep, suffix):
    name = f"a.{suffix}"
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16)
    if suffix == "npy":
        np.save(folder / name, grey / 255)
    elif suffix == "csv":
        np.savetxt(folder / name, grey / 255, delimiter=",")
    else:
        Image.fromarray(grey if suffix == "png" else grey.astype(np.uint16) * 257).save(
            folder / name
        )
    content = bytearray((folder / name).read_bytes())
    for place, byte in damage:
        content[int(place**3 * len(content))] = byte  # mostly in the header
    (folder / name).write_bytes(content[: math.ceil(len(content) * min(1.0, 2 * keep))])
    try:
        picture = map_of(folder, name)
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
        ("Rig 3\ntime_s,cof\n0,0.5\n2,0.6\n", "its header stands in line 2"),
        ("1,0.5\n2,0.6\n", "line 1: holds numbers where the names"),
    ],
)
def test_a_table_whose_header_is_elsewhere_is_told_where(tmp_path, text, said):
    (tmp_path / "mine.csv").write_text(text)
    with pytest.raises(BadInputError, match=said):
        load(str(tmp_path / "mine.csv"), [])
