"""Configuration: what is wrong with it is said by file, key and nearest valid choice."""

import datetime
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field, model_validator

from haptic_driver.config import URL, Section, config_dirs, parse, texture_dirs
from haptic_driver.errors import BadInputError
from haptic_driver.limits import ICNIRP_PUBLIC_A_RMS
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from model.support.errors import did_you_mean
from tests.haptic_driver.config_texts import CONFIGS, SIMULATED, changed


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch, tmp_path):
    """No `configs` folder beside the tests, and none named in the environment."""
    monkeypatch.delenv("HAPTIC_CONFIGS", raising=False)
    monkeypatch.chdir(tmp_path)


def refused(load, *arguments):
    with pytest.raises(BadInputError) as error:
        load(*arguments)
    assert error.value.exit_status == 2
    return error.value


def rig_file(tmp_path, old="", new="", content=SIMULATED):
    path = tmp_path / "bench.toml"
    path.write_text(changed(content, (old, new)), encoding="utf-8")
    return str(path)


# --- what is read
# ----------------------------------------------------------------------------------------------


def test_the_shipped_rig_becomes_operating_limits():
    config = load_rig("simulated")
    limits = config.operating_limits()
    assert config.simulated
    assert (limits.voltage_v, limits.frequency_low_hz, limits.frequency_high_hz) == (
        150.0,
        1.0,
        1e6,
    )
    assert limits.contact_current_a_rms == ICNIRP_PUBLIC_A_RMS
    assert limits.slew_v_per_s == 370e6
    assert limits.amplifier_current_a == 0.1
    assert limits.panel_capacitance_f == 1e-9
    assert limits.series_resistance_ohm == 0.0


@pytest.mark.parametrize("path", sorted((CONFIGS / "rigs").glob("*.toml")), ids=lambda p: p.stem)
def test_every_shipped_rig_is_valid(path):
    assert load_rig(str(path)).name


@pytest.mark.parametrize("path", sorted((CONFIGS / "models").glob("*.toml")), ids=lambda p: p.stem)
def test_every_shipped_model_is_valid(path):
    assert load_model(str(path)).name == path.stem


def test_whole_numbers_may_stand_for_floats(tmp_path):
    assert (
        load_rig(rig_file(tmp_path, "voltage_v = 150.0", "voltage_v = 120")).limits.voltage_v
        == 120.0
    )


# --- what is wrong
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "key", "offered"),
    [
        (
            "series_resistance_ohm =",
            "serie_resistance_ohm =",
            "limits.serie_resistance_ohm",
            "series_resistance_ohm",
        ),
        ("[controller]", "[controler]", "controler", "controller"),
    ],
)
def test_an_unknown_key_is_named_with_the_nearest(tmp_path, old, new, key, offered):
    path = rig_file(tmp_path, old, new)
    error = refused(load_rig, path)
    assert error.code == "unknown_key"
    assert f"{path}: unknown key '{key}'" in error.message
    assert error.hint.startswith(f"Did you mean '{offered}")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("voltage_v = 150.0", "voltage_v = nan", "limits.voltage_v"),
        ("voltage_v = 150.0", "", "limits.voltage_v"),
        ("frequency_hz = [1.0, 1e6]", "frequency_hz = [1e6, 1.0]", "[lowest, highest]"),
        ("[2.5e3, 0.5e-3]", "[0.5, 0.5e-3]", "contact_current_a_rms must rise"),
        ("contact_on_n = 0.15", "contact_on_n = 0.05", "finger.contact_off_n"),
        ('policy = "max_authority"', 'policy = "fastest"', "controller.policy"),
    ],
)
def test_a_wrong_value_is_named(tmp_path, old, new, words):
    path = rig_file(tmp_path, old, new)
    error = refused(load_rig, path)
    assert error.code == "bad_config"
    assert path in error.message
    assert words in error.message
    assert error.hint


@pytest.mark.parametrize("band", ["[1.0, 1e8]", "[1e-9, 1e6]"])
def test_a_band_beyond_the_generators_is_refused(tmp_path, band):
    """The 33220A makes sines of 1 uHz to 20 MHz; without this the driver fails with a traceback."""
    error = refused(load_rig, rig_file(tmp_path, "[1.0, 1e6]", band))
    assert error.code == "bad_config"
    assert "frequency" in error.message


def test_bad_toml_says_where(tmp_path):
    path = rig_file(tmp_path, "", "", content='name = "x"\nsimulated = \n')
    error = refused(load_rig, path)
    assert error.code == "bad_toml"
    assert path in error.message
    assert "line 2" in error.message


def test_a_file_of_bytes_is_refused(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    assert refused(load_rig, str(tmp_path / "bytes.toml")).code == "file_unreadable"


@pytest.mark.parametrize("load", [load_rig, load_model])
def test_a_missing_file_says_which_names_there_are(tmp_path, load):
    error = refused(load, str(tmp_path / "none.toml"))
    assert error.code == "file_not_found"
    assert "none.toml" in error.message
    assert ("simulated" if load is load_rig else "reference") in error.hint


@pytest.mark.parametrize(
    ("load", "name", "code", "nearest"),
    [
        (load_rig, "simulatd", "unknown_rig", "simulated"),
        (load_model, "refrence", "unknown_model", "reference"),
        (load_model, "tabel1", "unknown_model", "table1"),
    ],
)
def test_an_unknown_name_offers_the_nearest(load, name, code, nearest):
    error = refused(load, name)
    assert error.code == code
    assert f"'{name}'" in error.message
    assert f"Did you mean '{nearest}'" in error.hint


def test_a_mistake_in_a_model_file_is_bad_input(tmp_path):
    text = (CONFIGS / "models" / "reference.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(
        text.replace("hurst_exponent ", "hurst_exponnt "), encoding="utf-8"
    )
    error = refused(load_model, str(tmp_path / "mine.toml"))
    assert error.code == "bad_model"
    assert "hurst_exponnt" in error.message
    assert "Did you mean 'hurst_exponent'" in error.hint


# --- where it is found
# -----------------------------------------------------------------------------------------


def put(folder, name):
    path = folder / "rigs" / "bench.toml"
    path.parent.mkdir(parents=True)
    path.write_text(f'name = "{name}"\n{SIMULATED}', encoding="utf-8")


def test_the_named_folder_comes_before_the_local_one_and_the_programs_own(monkeypatch, tmp_path):
    put(tmp_path / "configs", "local")
    put(tmp_path / "elsewhere", "named")
    assert load_rig("bench").name == "local"
    monkeypatch.setenv("HAPTIC_CONFIGS", str(tmp_path / "elsewhere"))
    assert load_rig("bench").name == "named"
    assert load_rig("simulated").name == "simulated"  # still found where it was
    assert config_dirs() == [tmp_path / "elsewhere", Path("configs"), CONFIGS]
    assert texture_dirs() == [folder / "textures" for folder in config_dirs()]


def test_a_named_folder_that_is_not_there_is_passed_over(monkeypatch, tmp_path):
    monkeypatch.setenv("HAPTIC_CONFIGS", str(tmp_path / "none"))
    assert load_rig("simulated").simulated


def test_names_of_all_folders_are_offered(tmp_path):
    put(tmp_path / "configs", "local")
    assert "bench" in refused(load_rig, "bensch").hint
    assert "simulated" in refused(load_rig, "bensch").hint


class Pair(Section):
    """Two numbers that only go together."""

    low: float = 0.0
    high: float = 1.0

    @model_validator(mode="after")
    def _ordered(self) -> "Pair":
        if self.low > self.high:
            raise ValueError(f"low {self.low:g} is above high {self.high:g}")
        return self


def test_a_hint_for_keys_that_do_not_go_together_names_them():
    """It once said: Correct key ''."""
    error = refused(parse, Pair, {"low": 2.0}, "a.toml")
    assert error.message == "a.toml: low 2 is above high 1"
    assert error.hint == "Change a key that it names; the keys are: low, high"


def test_a_key_without_a_name_is_said():
    error = refused(parse, Pair, {"": 2.0}, "a.toml")
    assert error.message == 'a.toml: a key has no name ("")'
    assert error.hint == "Known: high, low"


def test_a_copy_of_a_rigs_file_has_the_name_of_its_own_file(tmp_path):
    (tmp_path / "bench7.toml").write_text(SIMULATED, encoding="utf-8")
    assert load_rig(str(tmp_path / "bench7.toml")).name == "bench7"


class Held(Section):
    """One of a list."""

    shape: int


class Holding(Section):
    """A file with a list."""

    held: list[Held]


def test_a_key_that_is_unknown_in_a_list_is_offered_those_of_its_section():
    with pytest.raises(BadInputError) as refused:
        parse(Holding, {"held": [{"shpe": 1}]}, "file")
    assert refused.value.hint == "Did you mean 'shape'? Known: shape"


def test_each_of_two_unknown_keys_is_offered_what_its_own_section_knows():
    """Only those beside the first had an offer."""
    with pytest.raises(BadInputError) as refused:
        parse(RigConfig, {"screen": {"widht_m": 0.1}, "output": {"latenzy_s": 0.0}}, "file")
    assert "Did you mean 'width_m'?" in refused.value.hint
    assert "Did you mean 'latency_s'?" in refused.value.hint


def test_a_wrong_kind_is_answered_before_what_is_missing():
    with pytest.raises(BadInputError) as refused:
        parse(RigConfig, {"amplifier": {"kind": "analogue"}}, "file")
    assert "amplifier.kind is 'analogue'" in refused.value.message
    assert refused.value.hint.startswith("Did you mean 'analog'?")


def test_a_name_that_continues_is_nearer_than_one_that_is_alike():
    assert did_you_mean("gain", ["kind", "gain_v_per_v"]) == "Did you mean 'gain_v_per_v'? "


class Dated(Section):
    """With a date and a text that a pattern judges."""

    measured_at: datetime.date
    url: Annotated[str, Field(pattern=URL)] = "http://a"


def test_a_date_in_quotes_and_a_wrong_pattern_are_told_in_words():
    with pytest.raises(BadInputError, match="a date stands without quotes, such as 2026-01-31"):
        parse(Dated, {"measured_at": "2026-11-28"}, "file")
    with pytest.raises(BadInputError, match="url: must begin with http://"):
        parse(Dated, {"measured_at": datetime.date(2026, 1, 1), "url": "a"}, "file")
