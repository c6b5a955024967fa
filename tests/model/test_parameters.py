from dataclasses import asdict, fields, replace
from pathlib import Path

import pytest

from model.description import read_model
from model.electric.dielectrics import GABRIEL_DRY, GABRIEL_WET, PowerLaw, Tabulated
from model.parameters import SPECIFICATION, TouchParameters
from model.support.errors import ModelError, nearest
from tests.fingers import MODELS, SHIPPED

NAMES = [f.name for f in fields(TouchParameters)]


@pytest.fixture
def write(tmp_path):
    def file(text: str, name: str = "finger.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return file


def with_parameter(name: str, entry: str) -> str:
    """The shipped file with another entry for one parameter."""
    lines = [
        f"{name} = {entry}" if line.split("=")[0].strip() == name else line
        for line in SHIPPED.splitlines()
    ]
    return "\n".join(lines)


def with_dielectric(table: str) -> str:
    head, rest = SHIPPED.split("[dielectric]")
    return head + table + "\n[parameters]" + rest.split("[parameters]")[1]


def test_shipped_reference_holds_table_one():
    """Table I and section IV.A of AliAbbasi et al. 2022, typed from the paper; roughness of the
    public code.
    """
    v = read_model(MODELS / "reference.toml").values
    assert (
        v.insulator_permittivity,
        v.insulator_thickness_m,
        v.insulator_conductivity_s_per_m,
    ) == (3.9, 1e-6, 1e-13)
    assert (v.air_conductivity_s_per_m, v.skin_thickness_m) == (1e-14, 200e-6)
    assert (v.screen_modulus_pa, v.screen_poisson_ratio) == (70e9, 0.15)
    assert (v.skin_modulus_pa, v.skin_poisson_ratio) == (10e6, 0.5)
    assert (v.roughness_rms_m, v.hurst_exponent) == (20e-6, 0.71)
    assert (v.roll_off_wavenumber_per_m, v.cut_off_wavenumber_per_m) == (1e3, 1e10)
    assert (v.contact_gamma, v.contact_area_m2, v.leak_scale, v.cof_off) == (
        0.45,
        100e-6,
        1.0,
        0.512,
    )


def test_table1_differs_from_reference_by_its_roughness_only():
    one, other = (asdict(read_model(MODELS / f"{n}.toml").values) for n in ("table1", "reference"))
    different = {k: v for k, v in one.items() if other[k] != v}
    assert different == {
        "roughness_rms_m": 22e-6,
        "hurst_exponent": 0.86,
        "roll_off_wavenumber_per_m": 8e3,
    }


@pytest.mark.parametrize("name", ["reference", "table1"])
def test_every_shipped_number_has_a_source(name):
    for parameter in read_model(MODELS / f"{name}.toml").parameters.values():
        assert parameter.source
        assert parameter.std is None or parameter.std > 0.0


def test_a_bare_number_is_enough_and_texts_have_defaults(write):
    text = "[parameters]\n" + "\n".join(
        f"{n} = {v!r}" for n, v in asdict(read_model(write(SHIPPED)).values).items()
    )
    model = read_model(write(text, "bare.toml"))
    assert model.name == "bare"
    assert model.friction_law == "applied_load"
    assert model.dielectric == GABRIEL_DRY
    assert model.variant == "corrected"
    assert model.parameters["cof_off"].std is None
    assert model.parameters["cof_off"].unit == "1"
    assert model.content_hash == read_model(MODELS / "reference.toml").content_hash


@pytest.mark.parametrize("name", NAMES)
def test_the_range_of_each_parameter_is_enforced(write, name):
    low, high = SPECIFICATION[name]["low"], SPECIFICATION[name]["high"]
    for wrong in (low - 0.01 * abs(low) - 1e-30, 1.01 * high):
        with pytest.raises(ModelError, match="out of range") as caught:
            read_model(write(with_parameter(name, repr(wrong))))
        assert name in caught.value.message
        assert "finger.toml" in caught.value.message
        assert SPECIFICATION[name]["unit"] in caught.value.hint


def test_a_file_that_is_silent_about_a_gap_offset_has_none(write):
    text = "\n".join(line for line in SHIPPED.splitlines() if not line.startswith("gap_offset_m"))
    assert read_model(write(text)).values.gap_offset_m == 0.0


HAS_A_USUAL_VALUE = {"gap_offset_m", "stray_capacitance_f", "open_circuit", "rest_softening"}


@pytest.mark.parametrize("name", sorted(set(NAMES) - HAS_A_USUAL_VALUE))
def test_each_parameter_must_be_given(write, name):
    text = "\n".join(line for line in SHIPPED.splitlines() if not line.startswith(name))
    with pytest.raises(ModelError, match=f"{name} is missing") as caught:
        read_model(write(text))
    assert SPECIFICATION[name]["about"] in caught.value.hint


@pytest.mark.parametrize("wrong", ["true", "inf", '"0.5"', "{ std = 0.1 }"])
def test_what_is_no_finite_number_is_refused(write, wrong):
    with pytest.raises(ModelError, match=r"cof_off: .* is not a finite number"):
        read_model(write(with_parameter("cof_off", wrong)))


@pytest.mark.parametrize("wrong", ["nan", "-0.1"])
def test_a_standard_deviation_is_a_number_too(write, wrong):
    with pytest.raises(ModelError, match=r"cof_off\.std"):
        read_model(write(with_parameter("cof_off", f"{{ value = 0.5, std = {wrong} }}")))


def test_an_endless_integer_is_refused(write):
    with pytest.raises(ModelError, match="cof_off"):
        read_model(write(with_parameter("cof_off", "1" + 400 * "0")))


@pytest.mark.parametrize(
    ("text", "key", "choice"),
    [
        ("frictionlaw = 'applied_load'\n" + SHIPPED, "frictionlaw", "friction_law"),
        (SHIPPED + "\nhurst_exponents = 0.7\n", "hurst_exponents", "hurst_exponent"),
        (with_parameter("cof_off", "{ value = 0.5, sd = 0.1 }"), "sd", "std"),
        (with_dielectric('[dielectric]\nset = "csv"\nfiel = "a.csv"'), "fiel", "file"),
        (
            with_dielectric('[dielectric]\nset = "power_law"\namplitud = 3.0'),
            "amplitud",
            "amplitude",
        ),
        (with_dielectric('[dielectric]\nset = "gabriel_dry"\nsett = 1'), "sett", "set"),
    ],
)
def test_an_unknown_key_is_an_error_with_the_nearest(write, text, key, choice):
    with pytest.raises(ModelError, match=f"unknown key '{key}'") as caught:
        read_model(write(text))
    assert f"Did you mean '{choice}'?" in caught.value.hint


def test_unknown_law_and_set_offer_the_nearest(write):
    with pytest.raises(ModelError, match="friction_law 'total' is unknown") as caught:
        read_model(
            write(SHIPPED.replace('friction_law = "applied_load"', 'friction_law = "total"'))
        )
    assert "total_load" in caught.value.hint
    with pytest.raises(ModelError, match="no dielectric set 'gabriel_dray'") as caught:
        read_model(write(with_dielectric('[dielectric]\nset = "gabriel_dray"')))
    assert "Did you mean 'gabriel_dry'?" in caught.value.hint


@pytest.mark.parametrize(
    "text", ["[dielectric]\nfile = 'a.csv'", "dielectric = 3", "dielectric = 'gabriel_dry'"]
)
def test_a_dielectric_without_a_set_is_refused(write, text):
    with pytest.raises(ModelError, match="has no key 'set'"):
        read_model(write(with_dielectric(text)))


def test_parameters_must_be_a_table(write):
    with pytest.raises(ModelError, match=r"\[parameters\]: is not a table"):
        read_model(write("parameters = 3\n"))


def test_files_that_cannot_be_read_are_named(tmp_path, write):
    with pytest.raises(ModelError, match=r"none\.toml does not exist"):
        read_model(tmp_path / "none.toml")
    with pytest.raises(ModelError, match=r"finger\.toml: not valid TOML"):
        read_model(write("parameters = = 3\n"))
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x81")
    with pytest.raises(ModelError, match=r"binary\.toml is not UTF-8 text"):
        read_model(binary)


def test_a_byte_order_mark_is_no_mistake(tmp_path, write):
    plain = write(with_parameter("gap_offset_m", "1e-7"))
    marked = tmp_path / "marked.toml"
    marked.write_bytes(b"\xef\xbb\xbf" + plain.read_bytes())
    assert read_model(marked).parameters == read_model(plain).parameters


@pytest.mark.parametrize("cut_off", [1e3, 1.99e3])
def test_the_cut_off_must_lie_above_the_roll_off(write, cut_off):
    with pytest.raises(ModelError, match="cut_off_wavenumber_per_m") as caught:
        read_model(write(with_parameter("cut_off_wavenumber_per_m", repr(cut_off))))
    assert "twice" in caught.value.hint
    assert (
        read_model(
            write(with_parameter("cut_off_wavenumber_per_m", "2e3"))
        ).values.cut_off_wavenumber_per_m
        == 2e3
    )


def test_power_law_and_table_are_read(write, tmp_path):
    text = (
        '[dielectric]\nset = "power_law"\neps_inf = 5\namplitude = 800.0\nexponent ='
        " 0.3\nconductivity_s_per_m = 2e-4"
    )
    assert read_model(write(with_dielectric(text))).dielectric == PowerLaw(5.0, 800.0, 0.3, 2e-4)
    with pytest.raises(ModelError, match="exponent is missing"):
        read_model(write(with_dielectric(text.replace("exponent = 0.3\n", ""))))
    (tmp_path / "own.csv").write_text(
        "frequency_hz,eps_real,conductivity_s_per_m\n1,10,1e-4\n2,11,1e-4\n"
    )
    table = read_model(
        write(with_dielectric('[dielectric]\nset = "csv"\nfile = "own.csv"'))
    ).dielectric
    assert isinstance(table, Tabulated)
    assert table.eps_real == (10.0, 11.0)
    with pytest.raises(ModelError, match="has no key 'file'"):
        read_model(write(with_dielectric('[dielectric]\nset = "csv"')))


@pytest.mark.parametrize(
    ("key", "value"), [("conductivity_s_per_m", -1e-4), ("exponent", 1.5), ("eps_inf", 0.0)]
)
def test_a_power_law_that_no_skin_has_is_refused(write, key, value):
    """A negative conductivity would make the leak beside the gap a source of power."""
    numbers = {
        "eps_inf": 5.0,
        "amplitude": 800.0,
        "exponent": 0.3,
        "conductivity_s_per_m": 2e-4,
    } | {key: value}
    lines = "\n".join(f"{name} = {number}" for name, number in numbers.items())
    with pytest.raises(ModelError, match=f"{key} = {value:g} is out of range"):
        read_model(write(with_dielectric(f'[dielectric]\nset = "power_law"\n{lines}')))


def test_nearest_lists_all_where_nothing_is_near():
    assert nearest("zzz", ["beta", "alpha"]) == "Known: alpha, beta"
    error = ModelError("what", "do")
    assert (str(error), error.__notes__) == ("what", ["hint: do"])
    assert str(ModelError("what")) == "what"


class TestIdentity:
    @pytest.fixture
    def model(self):
        return read_model(MODELS / "reference.toml")

    def test_name_comments_sources_and_order_do_not_count(self, model, write):
        lines = SHIPPED.split("[parameters]\n")
        turned = (
            lines[0].replace("#", "# also")
            + "[parameters]\n"
            + "\n".join(reversed(lines[1].splitlines()))
        )
        other = read_model(
            write(turned.replace("Table I", "the paper").replace('"reference"', '"mine"'))
        )
        assert other.name == "mine"
        assert other.content_hash == model.content_hash
        assert other.provenance() != model.provenance()

    @pytest.mark.parametrize("name", NAMES)
    def test_any_changed_number_counts(self, model, name):
        entry = model.parameters[name]
        changed = {
            **model.parameters,
            name: replace(entry, value=entry.value * (1.0 + 1e-12) + 1e-30),
        }
        assert replace(model, parameters=changed).content_hash != model.content_hash

    def test_law_set_and_variant_count(self, model):
        others = [
            model,
            replace(model, friction_law="total_load"),
            replace(model, dielectric=GABRIEL_WET),
            replace(model, dielectric=replace(GABRIEL_DRY, conductivity_s_per_m=2.0001e-4)),
            replace(model, dielectric=Tabulated("t", "s", (1.0, 2.0), (3.0, 4.0), (5.0, 6.0))),
            replace(model, dielectric=Tabulated("t", "s", (1.0, 2.0), (3.0, 4.0), (5.0, 6.1))),
            replace(model, variant="published"),
        ]
        assert len({m.content_hash for m in others}) == len(others)

    def test_the_name_of_a_dielectric_table_does_not_count(self, model):
        one, other = (
            Tabulated(n, f"{n}.csv", (1.0, 2.0), (3.0, 4.0), (5.0, 6.0)) for n in ("a", "b")
        )
        assert (
            replace(model, dielectric=one).content_hash
            == replace(model, dielectric=other).content_hash
        )
