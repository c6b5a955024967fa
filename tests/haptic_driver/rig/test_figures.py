"""Figures of a rig's file: each has a range that something real gives, so that none switches off
what it is for.
"""

import math
from contextlib import suppress
from typing import Annotated, get_args, get_origin

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import BaseModel, TypeAdapter, ValidationError

from haptic_driver.config import Kinds, Within
from haptic_driver.errors import BadInputError
from haptic_driver.limits import ICNIRP_PUBLIC_A_RMS
from haptic_driver.rig.config import LimitsConfig, RigConfig, load_rig
from haptic_driver.rig.parts.amplifiers import AnalogAmplifierConfig
from model.description import POWER_LAW
from model.effects import CATALOGUE
from model.parameters import SPECIFICATION
from tests.haptic_driver.config_texts import SIMULATED, changed

ELECTRODE_F = 100e-12  # about the least that an electrode under a finger and its lead have
ANY = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([1e308, -1e308, 1e-308, math.inf, math.nan, 0.0, 5e-324]),
    st.floats(-310.0, 308.0).map(lambda power: 10.0**power),
    st.floats(-12.0, 12.0).map(lambda power: 10.0**power),
)


def sections_in(annotation):
    """Every section that may stand at an annotation, and those inside, once each."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from sections_in(Annotated[field.annotation, *field.metadata, None])
    elif isinstance(annotation, Kinds):
        for name in annotation:
            yield from sections_in(annotation[name])
    else:
        for inner in get_args(annotation):
            yield from sections_in(inner)


def numbers_in(annotation, within=None):
    """(whether it is a float, its range) of all floats that may stand at an annotation."""
    if annotation is float:
        yield within
    elif get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        yield from numbers_in(inner, next((m for m in metadata if isinstance(m, Within)), None))
    else:
        for inner in get_args(annotation):
            yield from numbers_in(inner)


SECTIONS = list(dict.fromkeys(sections_in(RigConfig)))
FIGURES = {
    f"{section.__name__}.{name}": within
    for section in SECTIONS
    for name, field in section.model_fields.items()
    if name != "hide"  # effects, whose ranges the model has
    for within in numbers_in(Annotated[field.annotation, *field.metadata, None])
}


def test_every_figure_of_a_rig_has_a_range_and_a_reason():
    assert len(SECTIONS) > 25
    assert len(FIGURES) > 80
    for name, within in FIGURES.items():
        assert within is not None, name
        assert -math.inf < within.low < within.high < math.inf, name
        assert len(within.why) > 10, name


@given(name=st.sampled_from(sorted(FIGURES)), value=ANY)
def test_what_is_outside_is_refused_with_the_range_and_the_reason(name, value):
    within = FIGURES[name]
    assume(not within.low <= value <= within.high)
    with pytest.raises(ValidationError) as error:
        TypeAdapter(Annotated[float, within]).validate_python(value)
    (fault,) = error.value.errors()
    assert fault["msg"] == f"must be {within.low:g} to {within.high:g} ({within.why})"


def refused(tmp_path, *changes):
    path = tmp_path / "bench.toml"
    path.write_text(changed(SIMULATED, *changes))
    with pytest.raises(BadInputError) as error:
        load_rig(str(path))
    return error.value.message


LIFTING = [
    (
        "gain_v_per_v = 100.0",
        "gain_v_per_v = {}",
        "amplifier.gain_v_per_v",
        "1e-308",
        "0.1 to 10000",
    ),
    (
        "[2.5e3, 0.5e-3]",
        "[2.5e3, {}]",
        "limits.contact_current_a_rms.1.1",
        "1e+308",
        "1e-09 to 1e+09",
    ),
]


@pytest.mark.parametrize(("old", "new", "key", "value", "bounds"), LIFTING)
def test_a_figure_that_would_lift_a_limit_is_refused(tmp_path, old, new, key, value, bounds):
    said = refused(tmp_path, (old, new.format(value)))
    assert f"{key}: must be {bounds} (" in said
    assert said.endswith(f"), not {value}")


def test_a_limit_curve_ends_at_what_workers_may_bear(tmp_path):
    said = refused(
        tmp_path, ("[1.0, 0.5e-3], [2.5e3, 0.5e-3]", "[1.0, 0.5e-3], [50.0, 2e-3], [2.5e3, 0.5e-3]")
    )
    assert "contact_current_a_rms allows 2 mA at 50 Hz, more than 1 mA" in said
    said = refused(
        tmp_path,
        ("[[1.0, 0.5e-3], [2.5e3, 0.5e-3], [100e3, 20e-3], [10e6, 20e-3]]", "[[1e6, 40e-3]]"),
    )
    assert (
        "contact_current_a_rms allows 40 mA at 1 Hz" in said
    )  # the curve is held below its first point


def with_accepted(section, figures, tried):
    """A section with those of the figures tried that it accepts."""
    found = section.model_validate(figures)
    for name, value in tried.items():
        with suppress(ValidationError):
            found = section.model_validate(found.model_dump() | {name: value})
    return found


LIMITS = {"voltage_v": 150.0}
RIG = load_rig("simulated")
AMPLIFIER = {
    "gain_v_per_v": 100.0,
    "voltage_limit_v": 1e3,
    "current_limit_a": 0.1,
    "slew_limit_v_per_s": 1e9,
}


@given(
    limits=st.fixed_dictionaries(
        {},
        optional={
            "voltage_v": ANY,
            "series_resistance_ohm": ANY,
            "contact_current_a_rms": st.lists(
                st.tuples(ANY, ANY).map(list), min_size=1, max_size=3
            ),
        },
    ),
    amplifier=st.fixed_dictionaries(
        {}, optional={"current_limit_a": ANY, "slew_limit_v_per_s": ANY}
    ),
    frequency_hz=st.floats(0.0, 6.0).map(lambda power: 10.0**power),
)
def test_no_accepted_figure_lifts_the_current_bound_above_what_physics_gives(
    limits, amplifier, frequency_hz
):
    """Nor is what a lead or an amplifier is said to withhold more than a real one does."""
    found = {
        "limits": with_accepted(LimitsConfig, LIMITS, limits),
        "amplifier": with_accepted(AnalogAmplifierConfig, AMPLIFIER, amplifier),
    }
    allowed = RIG.model_copy(update=found).operating_limits()
    public_a = math.exp(np.interp(math.log(frequency_hz), *np.log(np.array(ICNIRP_PUBLIC_A_RMS).T)))
    assert float(allowed.contact_current_limit_a_rms(frequency_hz)) <= 2.0 * public_a * (1.0 + 1e-6)
    assert 0.0 < allowed.voltage_v <= 1000.0
    assert (
        2.0 * math.pi * 160.0 * ELECTRODE_F * allowed.series_resistance_ohm <= 1.01
    )  # it follows some carrier
    assert (
        allowed.amplifier_current_a >= 2.0 * math.pi * 1590.0 * ELECTRODE_F * 100.0
    )  # it drives some electrode
    by_slew_v = allowed.slew_v_per_s / (2.0 * math.pi * frequency_hz)
    assert math.isfinite(by_slew_v)


def test_every_figure_of_a_model_has_a_finite_range():
    ranges = {name: (said["low"], said["high"]) for name, said in SPECIFICATION.items()}
    ranges |= {
        f"{effect.name}.{p.name}": (p.low, p.high)
        for effect in CATALOGUE
        for p in effect.parameters()
    }
    ranges |= {name: (low, high) for name, (_, low, high) in POWER_LAW.items()}
    for name, (low, high) in ranges.items():
        assert -math.inf < low < high < math.inf, name
        assert high < 1e14, name
