"""`haptic texture import`: strokes, recordings, sounds and HaTT models of which the outcome is
known by hand.
"""

import json
import math
import re
import wave

import numpy as np
import pytest
from scipy.io import savemat

from haptic_driver.processes.samples import SAMPLE
from haptic_driver.textures.library import load_texture
from tests.haptic_driver.live.recorded_runs import record

SPEED_M_S = 0.040
TICK_S = 1e-3


def friction(position_m):
    """The surface under every stroke: a wave of 5 mm."""
    return 0.6 + 0.1 * np.sin(math.tau * position_m / 5e-3)


def there_and_back(offset_n=0.0):
    """Time, position, load and lateral force of a stroke of 30 mm to the right and back, then a
    rest, then a lift.
    """
    there = np.arange(0.010, 0.040, SPEED_M_S * TICK_S)
    position = np.concatenate([there, there[::-1], np.full(400, 0.010), np.full(100, 0.010)])
    side = np.concatenate([np.ones(there.size), -np.ones(there.size), np.zeros(500)])
    load = 0.5 + 0.1 * np.sin(np.arange(position.size) / 60.0)
    load[-100:] = 0.001
    return (
        np.arange(position.size) * TICK_S,
        position,
        load,
        side * load * friction(position) + offset_n,
    )


def write_csv(path, names, *columns):
    rows = (",".join(f"{cell:.9g}" for cell in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([names, *rows]))


def write_wav(path, samples, rate_hz, channels=1):
    with wave.open(str(path), "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(2)
        file.setframerate(rate_hz)
        file.writeframes((30_000 * samples).astype("<i2").tobytes())


def along(path, position_m, axis=0):
    texture = load_texture(str(path), [])
    places = (position_m, np.zeros_like(position_m))
    return texture.cof_at(*(places if axis == 0 else places[::-1]))


@pytest.fixture
def importing(haptic, tmp_path):
    """Import a file of this folder as t.toml, in true size; what the command did."""

    def run(name, *options):
        words = ("--out", tmp_path / "t.toml", "--perceptual-gain", 1, *options, "--json")
        return haptic("texture", "import", tmp_path / name, *words)

    return run


INSIDE_M = np.arange(0.011, 0.039, 1e-4)


def test_strokes_of_a_table_become_friction_over_position(importing, tmp_path):
    time, position, load, lateral = there_and_back(offset_n=0.01)
    names = "time_s,position_mm,normal_force_n,lateral_force_n"
    write_csv(tmp_path / "strokes.csv", names, time, 1e3 * position, load, lateral)
    said = importing("strokes.csv").said
    # Two strokes cancel the offset up to the difference of their loads, at most 0.2 N of 0.5: 0.01
    # N * 0.4 / 0.5 N.
    assert along(tmp_path / "t.toml", INSIDE_M) == pytest.approx(friction(INSIDE_M), abs=0.01)
    assert said["length_mm"] == pytest.approx(30.0, abs=0.2)
    assert said["speed_m_s"] == pytest.approx(SPEED_M_S, rel=0.01)
    assert said["share_used"] == pytest.approx(2 * 0.030 / SPEED_M_S / TICK_S / time.size, abs=0.02)


def test_strokes_are_played_three_times_as_strong_unless_one_says_otherwise(haptic, tmp_path):
    time, position, load, lateral = there_and_back()
    names = "time_s,position_mm,normal_force_n,lateral_force_n"
    write_csv(tmp_path / "strokes.csv", names, time, 1e3 * position, load, lateral)
    out = tmp_path / "t.toml"
    done = haptic("texture", "import", tmp_path / "strokes.csv", "--out", out)
    assert "3 times its variation" in done.out
    assert "10.1109/TOH.2021.3130091" in done.out
    # Six whole waves about 0.6.
    assert along(out, INSIDE_M) == pytest.approx(0.6 + 3.0 * (friction(INSIDE_M) - 0.6), abs=0.01)
    as_recorded = along(out.with_suffix(".csv"), INSIDE_M)
    assert as_recorded == pytest.approx(friction(INSIDE_M), abs=0.003)
    checked = haptic("texture", "check", out, "--json").said
    assert checked["perceptual_gain"] == 3.0
    assert checked["cof_high"] == pytest.approx(0.9, abs=0.01)
    assert "below_reach" in checked["flags"]
    out.write_text(out.read_text().replace("perceptual_gain = 3.0", "perceptual_gain = 1.0"))
    assert along(out, INSIDE_M) == pytest.approx(friction(INSIDE_M), abs=0.003)


def test_amplified_friction_is_cut_where_friction_ends(importing, tmp_path):
    _, position, load, lateral = (column[:1500] for column in there_and_back())
    names = "position_mm,normal_force_n,lateral_force_n"
    write_csv(tmp_path / "strokes.csv", names, 1e3 * position, load, lateral)
    said = importing("strokes.csv", "--perceptual-gain", 9).said
    assert said["played_cof"] == pytest.approx([0.01, 1.5], abs=0.02)
    assert along(tmp_path / "t.toml", INSIDE_M).min() == 0.01
    refused = importing("strokes.csv", "--perceptual-gain", 21, "--force")
    assert refused.said["error"]["code"] == "out_of_range"


def test_columns_may_have_other_names_and_no_times(importing, tmp_path):
    _, position, load, lateral = there_and_back()
    write_csv(tmp_path / "lab.csv", "x,Fz,Ft", 1e6 * position[:1400], load[:1400], lateral[:1400])
    columns = ("position_um=x", "normal_force_n=Fz", "lateral_force_n=Ft")
    options = [word for column in columns for word in ("--column", column)]
    done = importing("lab.csv", *options)
    assert along(tmp_path / "t.toml", INSIDE_M) == pytest.approx(friction(INSIDE_M), abs=0.003)
    assert done.said["speed_m_s"] is None


NAMES = "time_s,position_mm,normal_force_n,lateral_force_n"


def noisy(rng, offset_n=0.0):
    """The stroke there and back of a sensor with 2 mN of noise."""
    time, position, load, lateral = there_and_back(offset_n)
    noise = rng.normal(0.0, 2e-3, (2, time.size))
    return [time, 1e3 * position, load + noise[0], lateral + noise[1]]


def clipped(columns):
    columns[2][:] = np.minimum(columns[2], 0.5)


def dead_for_a_second(columns):
    columns[3][300:1300] = columns[3][300]


def a_code(columns):
    columns[3][700] = -9999.0


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (clipped, "normal_force_n is clipped at 0.5 N in "),
        (dead_for_a_second, "lateral_force_n stands still at "),
        (a_code, "lateral_force_n is -9999 N, far outside its own noise, at 38 mm, row 701"),
    ],
)
def test_a_force_that_is_none_makes_no_texture(importing, tmp_path, rng, spoil, said):
    """Clipped loads made friction too high, and a dead sensor a texture of its last number."""
    columns = noisy(rng)
    spoil(columns)
    write_csv(tmp_path / "strokes.csv", NAMES, *columns)
    refused = importing("strokes.csv").said["error"]
    assert refused["code"] == "bad_strokes"
    assert said in refused["message"]
    assert not (tmp_path / "t.toml").exists()


def test_a_moment_in_which_a_force_stood_still_is_left_out_and_told(importing, tmp_path, rng):
    columns = noisy(rng)
    columns[3][300:400] = columns[3][300]
    write_csv(tmp_path / "strokes.csv", NAMES, *columns)
    (doubt,) = importing("strokes.csv").said["doubts"]
    assert re.fullmatch(r"lateral_force_n stands still at \S+ N in 7% of its .*: left out", doubt)
    assert along(tmp_path / "t.toml", INSIDE_M) == pytest.approx(friction(INSIDE_M), abs=0.02)


def test_what_shows_the_zeros_of_the_forces_is_told(importing, tmp_path, rng):
    def doubts(*columns):
        write_csv(tmp_path / "strokes.csv", NAMES, *columns)
        return importing("strokes.csv", "--force").said["doubts"]

    assert doubts(*noisy(rng)) == []
    without_load, one_way = doubts(*noisy(rng, offset_n=0.15))
    assert re.fullmatch(r"without load the lateral force reads 1[45]\d mN", without_load)
    assert re.match(r"the lateral force is 0\.4\d+ N one way and 0\.1\d+ N the other", one_way)
    (nothing,) = doubts(*(column[:750] for column in noisy(rng)))
    assert nothing.startswith("nothing shows the zeros of the forces")


def test_a_table_without_rows_or_without_a_touch_makes_no_texture(importing, tmp_path):
    """A header alone was a traceback."""
    (tmp_path / "strokes.csv").write_text(NAMES)
    assert importing("strokes.csv").said["error"]["message"].endswith("has no rows")
    time, position, load, lateral = there_and_back()
    write_csv(tmp_path / "strokes.csv", NAMES, time, 1e3 * position, 0.0 * load, 0.0 * lateral)
    assert "0 of 2000 rows slide" in importing("strokes.csv").said["error"]["message"]


def test_columns_that_are_found_are_those_of_the_file(importing, tmp_path):
    time, position, load, lateral = there_and_back()
    write_csv(tmp_path / "lab.csv", "time_s,position (mm),Fz,Ft", time, position, load, lateral)
    said = importing("lab.csv").said["error"]["message"]
    assert said.endswith("column normal_force_n is missing; found: time_s, position (mm), Fz, Ft")


@pytest.mark.parametrize("times", ["time_s,", ""])
def test_where_a_stroke_turns_and_the_skin_only_stretches_nothing_is_read(
    importing, tmp_path, times
):
    """Friction comes up over 0.2 mm of every stroke; a place that only such ways reach was read as
    0.26.
    """
    time, position, load, lateral = (column[:1500] for column in there_and_back())
    starts = np.where(
        np.arange(position.size) < position.size / 2,
        position - position[0],
        position.max() - position,
    )
    lateral = lateral * np.minimum(starts / 0.2e-3, 1.0)
    names, columns = (
        f"{times}position_mm,normal_force_n,lateral_force_n",
        (1e3 * position, load, lateral),
    )
    write_csv(tmp_path / "strokes.csv", names, *((time, *columns) if times else columns))
    said = importing("strokes.csv").said
    everywhere_m = np.linspace(0.0102, 0.0398, 500)
    assert along(tmp_path / "t.toml", everywhere_m) == pytest.approx(
        friction(everywhere_m), abs=0.01
    )
    assert said["length_mm"] == pytest.approx(30.0, abs=0.2)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_recording_becomes_friction_along_the_way_it_slides(importing, tmp_path, axis):
    time, position, load, lateral = there_and_back()
    samples = np.zeros(time.size, SAMPLE)
    samples["time_s"], samples["normal_force_n"], samples["lateral_force_n"] = time, load, lateral
    samples["position_y_m" if axis else "position_x_m"] = position
    samples["speed_m_s"] = np.abs(np.gradient(position, TICK_S))
    samples["in_contact"] = load > 0.1
    samples["lateral_force_n"][300:310] = np.nan  # a saturated sensor
    record(tmp_path / "run.h5", samples)
    assert importing("run.h5").said["texture"] == str(tmp_path / "t.toml")
    found = along(tmp_path / "t.toml", INSIDE_M, axis)
    assert found == pytest.approx(friction(INSIDE_M), abs=0.003)


def test_a_sound_becomes_waves_as_long_as_the_speed_makes_them(importing, tmp_path):
    rate_hz, tone_hz = 8000, 25.0  # at 0.05 m/s waves of 2 mm
    seconds = np.arange(4 * rate_hz) / rate_hz
    write_wav(tmp_path / "cloth.wav", 0.5 * np.sin(math.tau * tone_hz * seconds), rate_hz)
    scale = ("--speed", "0.05", "--mean-cof", "0.65", "--amplitude-cof", "0.1")
    done = importing("cloth.wav", *scale)
    x_m = np.arange(0.01, 0.15, 5e-5)
    # Averaged over 0.1 mm and straight in between; scaled to its crest, of which 20 points a period
    # miss at most 1.2 %.
    assert along(tmp_path / "t.toml", x_m) == pytest.approx(
        0.65 + 0.1 * np.sin(math.tau * x_m / 2e-3), abs=0.003
    )
    assert done.said["length_mm"] == pytest.approx(200.0)
    beyond = along(tmp_path / "t.toml", np.array([0.2505]))
    assert beyond == pytest.approx(along(tmp_path / "t.toml", np.array([0.0505])))  # it repeats


# --- raw trials, by the map of haptic rows
# ----------------------------------------------------------------------------------

GF_N = 9.80665e-3  # standard gravity times a gram
FORCES = """
[columns.time]
name = "Zeit"
unit = "ms"
[columns.normal_force]
name = "Fz"
unit = "gf"
sign = -1
[columns.lateral_force]
name = "Fx"
unit = "mN"
offset = 12.0
"""
WITHOUT_VOLTAGE = """
[conditions]
values = { voltage = 0.0 }
units = { voltage = "V", speed = "mm/s" }
[[windows]]
after = "motion"
start_s = 0.0
end_s = 1.6
"""
WEG = """
[columns.position]
name = "Weg"
unit = "mm"
offset = 100.0
"""
TEMPO = """
[columns.speed]
name = "v"
unit = "mm/s"
"""


def as_a_lab_has_it(along_the_way):
    """Columns by name of the stroke there and back: ms, gf pressing negative, mN beside an offset,
    and the way.
    """
    time, _, load, lateral = there_and_back()
    return {"Zeit": 1e3 * time, "Fz": -load / GF_N, "Fx": 1e3 * lateral + 12.0, **along_the_way}


def write_lab_csv(path, columns):
    names = ";".join(columns)
    rows = zip(*columns.values(), strict=True)
    lines = [";".join(f"{x:.9g}" for x in row).replace(".", ",") for row in rows]
    path.write_text("\n".join(["Messung Reibung", "Sensor;Nano17", "", names, *lines]) + "\n")


def of_the_way(time, position):
    return {"Weg": 1e3 * position + 100.0}


def of_the_speed(time, position):
    return {"v": 1e3 * np.gradient(position, time)}


COMMAS = '[file]\nseparator = ";"\ndecimal = ","\n'
LAB_FILES = [
    ("a.csv", write_lab_csv, COMMAS + WEG, of_the_way, 0.0),
    ("a.mat", savemat, TEMPO, of_the_speed, 0.010),
]


@pytest.mark.parametrize(("name", "write", "said", "way", "begins_m"), LAB_FILES)
def test_a_raw_trial_becomes_friction_over_position_as_its_map_says(
    importing, tmp_path, name, write, said, way, begins_m
):
    """Summed speeds count from where the stroke begins."""
    time, position, *_ = there_and_back()
    write(tmp_path / name, as_a_lab_has_it(way(time, position)))
    (tmp_path / "map.toml").write_text(said + FORCES + "[motion]\n" + WITHOUT_VOLTAGE)
    found = importing(name, "--map", tmp_path / "map.toml").said
    # A sum of speeds by differences is off by half a step, 0.02 mm, at each of two turns:
    # 0.1 tau/5 mm times 0.04 mm.
    felt = along(tmp_path / "t.toml", INSIDE_M - begins_m)
    assert felt == pytest.approx(friction(INSIDE_M), abs=0.006)
    assert found["length_mm"] == pytest.approx(30.0, abs=0.2)
    assert found["speed_m_s"] == pytest.approx(SPEED_M_S, rel=0.01)


def test_a_trial_on_a_stage_needs_no_way_but_its_set_speed_and_load(importing, tmp_path):
    """A window of 0.2 to 0.6 s at 40 mm/s is a way of 16 mm; before it friction is not counted."""
    seconds = np.arange(0.0, 0.7, TICK_S)
    there_m = SPEED_M_S * (seconds - 0.2)
    lateral = 0.5 * np.where(seconds < 0.2, 3.0, friction(there_m))
    np.savez(tmp_path / "a.npz", Ft=lateral / GF_N)
    (tmp_path / "map.toml").write_text(
        """
        [file]
        rate_hz = 1000.0
        [columns.lateral_force]
        name = "Ft"
        unit = "gf"
        [conditions]
        values = { voltage = 80.0, frequency = 250.0, speed = 40.0, normal_force = 500.0 }
        units = { voltage = "V", frequency = "Hz", speed = "mm/s", normal_force = "mN" }
        [voltage_on]
        start_s = 0.1
        [[windows]]
        start_s = 0.1
        end_s = 0.5
        """
    )
    found = importing("a.npz", "--map", tmp_path / "map.toml").said
    assert found["length_mm"] == pytest.approx(16.0, abs=0.5)  # the skin settles over 0.3 mm
    inside_m = np.arange(0.001, 0.0155, 1e-4)
    felt = along(tmp_path / "t.toml", inside_m + SPEED_M_S * 0.2)
    assert felt == pytest.approx(friction(inside_m), abs=0.003)


def test_a_trial_that_makes_no_texture_is_refused_by_name(importing, tmp_path):
    time, position, *_ = there_and_back()
    (tmp_path / "trials").mkdir()
    for name in ("trials/a.csv", "trials/b.csv"):
        write_lab_csv(tmp_path / name, as_a_lab_has_it(of_the_way(time, position)))
    said = tmp_path / "map.toml"

    def refused(text, *options, name="trials/a.csv"):
        said.write_text(text)
        done = importing(name, "--map", said, *options)
        assert done.status == 2
        return done.said["error"]

    error = refused(COMMAS + FORCES + WITHOUT_VOLTAGE)
    assert (error["code"], "columns.position" in error["hint"]) == ("bad_strokes", True)
    assert "nothing says where the finger is" in error["message"]
    whole = COMMAS + WEG + FORCES + WITHOUT_VOLTAGE
    error = refused(whole.replace('"gf"', '"g"'))
    assert (error["code"], "gf" in error["hint"]) == ("unknown_unit", True)
    refused(whole.replace("1.6", "9.0"))
    assert "2 trials" in refused(whole, name="trials")["message"]
    assert refused(whole, "--column", "position_mm=Weg")["code"] == "usage"
    error = refused(whole, "--out", said, "--force")
    assert "map.toml: is read, and would be overwritten" in error["message"]
    assert not (tmp_path / "t.toml").exists()


# --- HaTT: a made file of the same form
# ---------------------------------------------------------------------------


def line_frequencies(polynomial):
    """Line spectral frequencies by their definition: angles of the zeros of A(z) plus and minus its
    mirror image.
    """
    forward, mirrored = np.append(polynomial, 0.0), np.append(0.0, polynomial[::-1])
    angles = np.angle(np.concatenate([np.roots(forward + mirrored), np.roots(forward - mirrored)]))
    return np.sort(angles[(angles > 1e-6) & (angles < math.pi - 1e-6)])


def resonance(frequency_hz, rate_hz=1000.0, radius=0.97):
    """Coefficients of a process of order 3 that rings at a frequency."""
    pole = radius * np.exp(1j * math.tau * frequency_hz / rate_hz)
    return np.poly([pole, pole.conjugate(), 0.3]).real


def values(name, numbers):
    return (
        f"<{name}>" + "".join(f"<value>{number:.12g}</value>" for number in numbers) + f"</{name}>"
    )


def hatt(models, head="<mu>0.62</mu><SampleRate>1000</SampleRate><maxSpeed>200</maxSpeed>"):
    body = "".join(
        f"<model>{values('ARlsf', line_frequencies(resonance(ring_hz)))}"
        f"{values('MAlsf', line_frequencies([1.0, 0.2]))}"
        f"<var>{variance}</var><gain>0.5</gain><speedMod>{speed}</speedMod><forceMod>{force}</forceMod></model>"
        for speed, force, ring_hz, variance in models
    )
    return f"<modelSet>{head}{body}</modelSet>"


SQUARE = [
    (20, 0.2, 50.0, 1.0),
    (20, 1.0, 50.0, 1.0),
    (120, 0.2, 150.0, 1.0),
    (120, 1.0, 150.0, 16.0),
    (70, 0.6, 100.0, 1.0),
]
RMS = ("--cof-rms", "0.02")


def ring_of(path, speed_m_s, normal_force_n):
    """The frequency at which a texture is strongest for a finger of a speed and a load."""
    x_m = np.arange(0.0, 0.32, 1e-5)
    cof = (
        load_texture(str(path), []).under(speed_m_s, normal_force_n).cof_at(x_m, np.zeros_like(x_m))
    )
    strength = np.abs(np.fft.rfft((cof - cof.mean()) * np.hanning(cof.size))) ** 2
    smooth = np.convolve(strength, np.ones(25), "same")
    return np.fft.rfftfreq(cof.size, 1e-5)[smooth.argmax()] * speed_m_s, cof.std()


def test_all_hatt_models_are_kept_and_ring_as_they_do_at_a_speed_and_load(
    importing, haptic, tmp_path
):
    (tmp_path / "Models_Made.xml").write_text(hatt(SQUARE))
    done = importing("Models_Made.xml", *RMS)
    assert done.said["processes"] == 5
    assert done.said["speed_m_s"] == [0.02, 0.12]
    places = ((0.02, 0.2), (0.12, 0.2), (0.07, 0.6), (0.12, 1.0))
    found = [ring_of(tmp_path / "t.toml", *at) for at in places]
    ring_hz, cof_rms = zip(*found, strict=True)
    assert ring_hz == pytest.approx([50.0, 150.0, 100.0, 150.0], abs=4.0)
    # The one that vibrates most, and the same with a sixteenth of its variance.
    assert cof_rms[3] == pytest.approx(0.02, rel=0.03)
    assert cof_rms[1] == pytest.approx(0.25 * cof_rms[3], rel=0.03)
    mean = along(tmp_path / "t.toml", np.linspace(0.0, 0.064, 5000)).mean()
    assert mean == pytest.approx(0.62, abs=1e-3)  # its mu is the mean
    assert [path.name for path in tmp_path.glob("t.*")] == ["t.toml"]
    assert (
        haptic("texture", "preview", tmp_path / "t.toml", "--out", tmp_path / "t.png").status == 0
    )


# --- what is refused
# ----------------------------------------------------------------------------------------------

STILL = "position_mm,normal_force_n,lateral_force_n,time_s\n" + "\n".join(
    f"3,0.5,0.3,{i / 100}" for i in range(50)
)
ROW = "position_mm,normal_force_n,lateral_force_n\n"
SCALE = ["--speed", "0.05", "--mean-cof", "0.65", "--amplitude-cof", "0.1"]
REFUSED = [
    (
        "a.csv",
        STILL,
        [],
        "bad_strokes",
        "a.csv: 0 of 50 rows slide in contact",
        "faster than 2 mm/s",
    ),
    (
        "a.csv",
        f"time_s,{ROW}" + 3 * "".join(f"{t / 100},{t},0.5,0.3\n" for t in range(20)),
        [],
        "bad_strokes",
        "line 22: time_s does not rise: it begins again, from 0.19 to 0: 3 runs in one file",
        "each stroke a file of its own",
    ),
    (
        "a.csv",
        ROW + "".join(f"{i},-0.5,0.3\n" for i in range(30)),
        [],
        "bad_strokes",
        "all loads are negative, -0.5 N in the median",
        "change its sign",
    ),
    (
        "a.csv",
        ROW + "\n".join(f"{i},0.5,300" for i in range(30)),
        [],
        "bad_strokes",
        "friction is 600 at 1 mm",
        "in N",
    ),
    ("a.h5", "junk", [], "recording_unreadable", "a.h5", "haptic record"),
    ("a.wav", "RIFF", SCALE, "bad_wav", "a.wav is no sound file", "WAV"),
    (
        "a.wav",
        "",
        [*SCALE[2:], "--speed", "50"],
        "out_of_range",
        "--speed 50 m/s",
        "0.005 to 1 m/s",
    ),
    (
        "a.csv",
        ROW + "1,1,1\n" * 300_001,
        [],
        "table_too_large",
        "more than 300000 rows",
        "Leave some out",
    ),
    ("a.xml", hatt(SQUARE), ["--cof-rms", "0.9"], "bad_texture", "friction goes from -", "Lower"),
    ("a.xml", hatt(SQUARE), SCALE, "texture_needs_scale", "how much friction", "--cof-rms 0.02"),
    ("a.ogg", "", [], "bad_ending", "'.ogg' is not a file that can be imported", ".wav"),
]


@pytest.mark.parametrize(("name", "content", "options", "code", "said", "hint"), REFUSED)
def test_what_cannot_be_used_is_refused_and_nothing_written(
    importing, tmp_path, name, content, options, code, said, hint
):
    (tmp_path / name).write_text(content)
    done = importing(name, *options)
    assert (done.status, done.said["error"]["code"]) == (2, code), done.err
    assert said in done.said["error"]["message"]
    assert hint in done.said["error"]["hint"]
    assert [path.name for path in tmp_path.iterdir()] == [name]


NOT_HATT = [
    ('<!DOCTYPE a [<!ENTITY b "cc">]><a>&b;</a>', "has a document type"),
    ("<modelSet>" * 100_000, "is not XML"),
    (f"<modelSet>{'<model/>' * 100_000}</modelSet>", "has 100000 models"),
    (hatt(SQUARE, "<mu>slippery</mu>"), "has mu = slippery"),
    (hatt(SQUARE).replace("<value>0.", "<value>3.", 1), "1 has 3 frequencies"),
    (hatt([(20, 0.2, 50.0, 0.0)]), "has no model that vibrates"),
]


@pytest.mark.parametrize(("content", "said"), NOT_HATT, ids=range(len(NOT_HATT)))
def test_what_is_no_file_of_hatt_models_is_refused(importing, tmp_path, content, said):
    (tmp_path / "a.xml").write_text(content)
    error = importing("a.xml", *RMS).said["error"]
    assert error["code"] == "bad_hatt"
    assert said in error["message"]
    assert "Penn" in error["hint"]
    assert not (tmp_path / "t.toml").exists()


def test_a_wav_whose_header_promises_more_than_it_holds_is_read_no_further(importing, tmp_path):
    write_wav(tmp_path / "a.wav", np.zeros(4000), 8000)
    content = bytearray((tmp_path / "a.wav").read_bytes())
    content[40:44] = (2**31 - 2).to_bytes(4, "little")  # the length of the data
    (tmp_path / "a.wav").write_bytes(content)
    done = importing("a.wav", *SCALE)
    assert done.said["error"]["code"] in ("bad_wav", "silent")
    write_wav(tmp_path / "a.wav", np.zeros(4000), 8000, channels=2)
    done = importing("a.wav", *SCALE)
    assert "has 2 channels" in done.said["error"]["message"]


def test_a_wav_that_is_cut_off_is_refused_and_one_from_a_pipe_is_not(importing, tmp_path):
    """A program that writes to a pipe cannot say a length, and leaves all ones in its place."""
    file = tmp_path / "a.wav"
    write_wav(file, np.sin(np.arange(8000) / 50.0), 8000)
    whole = file.read_bytes()
    file.write_bytes(whole[:8000])
    error = importing("a.wav", *SCALE).said["error"]
    assert "a.wav is cut off" in error["message"]
    assert "Copy or export it again" in error["hint"]
    assert not (tmp_path / "t.toml").exists()
    unknown = b"\xff" * 4
    file.write_bytes(whole[:4] + unknown + whole[8:40] + unknown + whole[44:])
    piped = importing("a.wav", *SCALE, "--force")
    file.write_bytes(whole)
    assert importing("a.wav", *SCALE, "--force").said == piped.said


STROKES = "time_s,position_m,normal_force_n,lateral_force_n"


def test_nothing_is_overwritten_unasked_and_never_the_source(importing, tmp_path):
    source = tmp_path / "s.csv"
    write_csv(source, STROKES, *there_and_back())
    assert importing("s.csv").status == 0
    before = source.read_bytes()
    for options, words in (
        ((), "exists already"),
        (("--out", tmp_path / "s.toml", "--force"), "is read, and would be overwritten"),
    ):
        error = importing("s.csv", *options).said["error"]
        assert error["code"] == "file_exists"
        assert words in error["message"]
    assert source.read_bytes() == before
    assert importing("s.csv", "--force").status == 0


def test_a_file_name_never_breaks_the_texture(importing, tmp_path):
    source, out = tmp_path / 'a "quoted" \\ name.csv', tmp_path / 'my "own".toml'
    write_csv(source, STROKES, *there_and_back())
    assert importing(source.name, "--out", out).status == 0
    assert json.dumps(source.name, ensure_ascii=False)[1:-1] in out.read_text()
    assert np.isfinite(along(out, INSIDE_M)).all()
