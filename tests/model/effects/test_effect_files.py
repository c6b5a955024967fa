"""Effects in a model file: `[effects.NAME]`."""

import json

import pytest

from model.analysis.uncertainty import cof_interval_at, uncertain_numbers
from model.description import ModelDescription, read_model
from model.effects import BY_NAME, CATALOGUE, Effect
from model.support.errors import ModelError
from tests.fingers import SHIPPED

RESISTANCE = "[effects.series_resistance]\nresistance_ohm = 1e4\n"
BANDWIDTH = "[effects.amplifier_bandwidth]\ncutoff_hz = 2e4\norder = 1.5\n"
every_effect = pytest.mark.parametrize(
    "effect", CATALOGUE, ids=[effect.name for effect in CATALOGUE]
)


@pytest.fixture
def read(tmp_path):
    """The shipped finger with more lines at its end."""

    def model(*tables: str) -> ModelDescription:
        path = tmp_path / "finger.toml"
        path.write_text("\n".join([SHIPPED, *tables]), encoding="utf-8")
        return read_model(path)

    return model


def table(effect: type[Effect], **changes: str | None) -> str:
    entries = {p.name: repr(p.median) for p in effect.parameters()} | changes
    return "\n".join(
        [f"[effects.{effect.name}]", *(f"{k} = {v}" for k, v in entries.items() if v is not None)]
    )


def test_without_a_table_there_is_no_effect(read):
    assert read().effects == ()
    assert read("[effects]").effects == ()
    assert read("[effects]").content_hash == read().content_hash


@every_effect
def test_every_effect_is_read(read, effect):
    found = read(table(effect))
    assert found.effects == (effect(**{p.name: p.median for p in effect.parameters()}),)
    assert {n: p.unit for n, p in found.effect_parameters[effect.name].items()} == {
        p.name: p.unit for p in effect.parameters()
    }
    assert found.content_hash != read().content_hash
    assert json.loads(json.dumps(found.provenance())) == found.provenance()
    assert list(found.provenance()["effects"]) == [effect.name]


@every_effect
def test_every_parameter_must_be_given_or_is_as_usual_and_in_range(read, effect):
    for p in effect.parameters():
        if p.name in effect.usual():
            (found,) = read(table(effect, **{p.name: None})).effects
            assert getattr(found, p.name) == effect.usual()[p.name]
        else:
            with pytest.raises(
                ModelError, match=rf"\[effects\.{effect.name}\]: {p.name} is missing"
            ) as caught:
                read(table(effect, **{p.name: None}))
            assert all(
                known.name in caught.value.hint
                for known in effect.parameters()
                if known.name not in effect.usual()
            )
        for wrong in (p.low - 0.01 * abs(p.low) - 1e-30, 1.01 * p.high):
            with pytest.raises(
                ModelError, match=rf"finger\.toml, \[effects\.{effect.name}\]: {p.name} = "
            ) as caught:
                read(table(effect, **{p.name: repr(wrong)}))
            assert "out of range" in caught.value.message
            assert p.unit in caught.value.hint
        for end in (p.low, p.high):
            (found,) = read(table(effect, **{p.name: repr(end)})).effects
            assert getattr(found, p.name) == end
        for wrong in ("nan", "true", '"1"'):
            with pytest.raises(ModelError, match=f"{p.name}: .* is not a finite number"):
                read(table(effect, **{p.name: wrong}))


@pytest.mark.parametrize(
    ("wrong", "choice"),
    [("series_resistence", "series_resistance"), ("johnson_rahbek", "johnsen_rahbek")],
)
def test_an_unknown_effect_is_an_error_with_the_nearest(read, wrong, choice):
    with pytest.raises(ModelError, match=rf"\[effects\]: unknown key '{wrong}'") as caught:
        read(f"[effects.{wrong}]\nx = 1.0")
    assert f"Did you mean '{choice}'?" in caught.value.hint
    assert all(name in caught.value.hint for name in BY_NAME)


def test_what_is_no_table_is_refused(read, tmp_path):
    with pytest.raises(
        ModelError, match=r"\[effects\]: series_resistance is not a table"
    ) as caught:
        read("[effects]\nseries_resistance = 1e4")
    assert "resistance_ohm" in caught.value.hint
    path = tmp_path / "flat.toml"
    path.write_text("effects = 3\n" + SHIPPED, encoding="utf-8")
    with pytest.raises(ModelError, match=r"\[effects\]: is not a table"):
        read_model(path)


def test_std_and_source_are_kept_and_do_not_count(read):
    rich = read(
        "[effects.series_resistance]\nresistance_ohm = { value = 1e4, std = 500.0, source ="
        ' "ohmmeter" }'
    )
    parameter = rich.effect_parameters["series_resistance"]["resistance_ohm"]
    assert (parameter.value, parameter.std, parameter.source, parameter.unit) == (
        1e4,
        500.0,
        "ohmmeter",
        "ohm",
    )
    assert rich.content_hash == read(RESISTANCE).content_hash
    assert rich.provenance() != read(RESISTANCE).provenance()
    with pytest.raises(ModelError, match=r"resistance_ohm\.std = -1 is negative"):
        read("[effects.series_resistance]\nresistance_ohm = { value = 1e4, std = -1.0 }")


def test_effects_are_in_the_catalogues_order_whatever_the_files(read):
    one, other = read(RESISTANCE, BANDWIDTH), read(BANDWIDTH, RESISTANCE)
    assert [effect.name for effect in one.effects] == ["amplifier_bandwidth", "series_resistance"]
    assert one.effects == other.effects
    assert one.content_hash == other.content_hash


def test_an_origin_is_allowed_and_does_not_count(read):
    fitted = read('[origin]\nfitted_to = "a table of measurements"\nrows = 12\n')
    assert fitted.content_hash == read().content_hash
    with pytest.raises(ModelError, match="unknown key 'orgin'") as caught:
        read("[orgin]\nrows = 12")
    assert "Did you mean 'origin'?" in caught.value.hint


@every_effect
def test_a_model_that_leaves_out_what_it_may_has_an_uncertainty_all_the_same(read, effect):
    """A slew limit without its sharpness once ended `haptic solve` with a KeyError."""
    found = read(table(effect, **dict.fromkeys(effect.usual())))
    numbers = uncertain_numbers(found)
    assert not {f"{effect.name}.{name}" for name in effect.usual()} & {
        number.name for number in numbers
    }
    interval = cof_interval_at(found, 250.0, 75.0, 0.5)
    assert interval is not None
    assert interval[0] <= interval[1]
