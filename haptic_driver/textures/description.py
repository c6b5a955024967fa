"""What a texture file may say: keys, ranges, and errors that name the key."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, RootModel, model_validator

from haptic_driver import config
from haptic_driver.config import Checked
from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Interpolation, Outside
from haptic_driver.textures.bands import BANDS, EDGES_HZ
from haptic_driver.textures.objects import TEXTURE_COF, Cof, LengthMm, OriginMm, SceneDescription
from haptic_driver.textures.process import reflections

# The finest detail that reaches a finger: its distance per tick of 1 ms at 100 mm/s. The friction
# of skin itself follows to 13.8 Hz per mm/s (arXiv 2505.11162), that is to 0.07 mm.
FINEST_MM = 0.1
SHORTEST_PERIOD_MM = 2.0 * FINEST_MM
LEAST_WAVES = 4  # of the lowest frequency in a spectrum's tile: so many that each band has one
SAMPLES_PER_WAVE = 12  # straight lines between them miss a crest by 1 - cos(pi/12), 3.4 %
MOST_PROCESSES = 1000
LOWEST_SPEED_MM_S = 5.0  # below, waves up to 800 Hz are finer than any that a finger follows
FINEST_WAVE_MM = 0.05  # of a spectrum, which an analog envelope brings out between the ticks
LARGEST_NOISE_PIXELS = 1400  # along one side: two million, the most that render takes
LONGEST_TABLE_ROWS = 25_000  # of a profile or a script

PeriodMm = Annotated[float, Field(ge=SHORTEST_PERIOD_MM, le=10_000.0)]
AmplitudeCof = Annotated[float, Field(ge=0.0, le=TEXTURE_COF[1])]
Seconds = Annotated[float, Field(ge=0.0, le=86_400.0)]
Shape = Annotated[float, Field(ge=0.1, le=100.0)]
Coefficients = Annotated[
    list[Annotated[float, Field(ge=-1e3, le=1e3)]], Field(min_length=1, max_length=100)
]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
GAINS = (0.0, 20.0)  # by which what was recorded may be multiplied
Gain = Annotated[float, Field(ge=GAINS[0], le=GAINS[1])]


_FOR_BOTH_AXES = BeforeValidator(
    lambda pitch_mm: pitch_mm if isinstance(pitch_mm, list) else [pitch_mm, pitch_mm]
)
PitchMm = Annotated[list[LengthMm], _FOR_BOTH_AXES, Field(min_length=2, max_length=2)]
FileName = Annotated[str, Field(min_length=1)]


# Strict: TOML has types of its own, so the text "0.6" where a number belongs is a mistake.
class _Description(Checked, strict=True, allow_inf_nan=False):
    description: str = Field(default="", description="in words")

    def wave_m(self) -> float:
        """The finest wave whose place may give way; inf where none may."""
        return math.inf


class _Detailed(_Description):
    """What has places, of which those of waves may count less than their length."""

    placement: Literal["space", "time"] | None = Field(
        default=None,
        description=(
            "what is kept where a panel reports seldom: places (`space`) or the length of waves"
            " (`time`). By default `time` for gratings, noise and spectra finer than places are"
            " known"
        ),
    )

    def wave_m(self) -> float:
        """0 for `time`, inf for `space`."""
        return {None: 1e-3 * self.finest_mm(), "time": 0.0, "space": math.inf}[self.placement]

    def finest_mm(self) -> float:
        """The finest wave; inf where it may be no wave."""
        return math.inf


class UniformDescription(_Description):
    """The same friction everywhere."""

    kind: Literal["uniform"]
    cof: Cof = Field(description="friction")


def require_swing(mean_cof: float, amplitude_cof: float) -> None:
    """ValueError where friction would leave what a texture may say."""
    low, high = mean_cof - amplitude_cof, mean_cof + amplitude_cof
    if low < TEXTURE_COF[0] or high > TEXTURE_COF[1]:
        lowest, highest = TEXTURE_COF
        raise ValueError(
            f"mean_cof and amplitude_cof reach {low:g} to {high:g}, outside {lowest} to {highest}"
        )


class GratingDescription(_Detailed):
    """The middle of two frictions, plus or minus an amplitude, in waves."""

    kind: Literal["grating"]
    mean_cof: Cof = Field(description="middle of the two frictions")
    amplitude_cof: AmplitudeCof = Field(description="how far friction goes from the middle")
    period_mm: PeriodMm = Field(description="from one ridge to the next")
    wave: Literal["sine", "square", "sawtooth"] = Field(
        default="sine", description="shape of one period"
    )
    duty: Annotated[float, Field(ge=0.0, le=1.0)] | None = Field(
        default=None,
        description="share of a period that a square wave is high, or a sawtooth rises",
    )
    direction_deg: Degrees = Field(default=0.0, description="from x towards y, which points down")
    phase_deg: Degrees = Field(default=0.0, description="of a period, at the origin")

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        require_swing(self.mean_cof, self.amplitude_cof)
        if self.wave == "sine" and self.duty is not None:
            raise ValueError('key \'duty\' belongs to wave = "square" or "sawtooth", not to a sine')
        shorter_mm = self.period_mm * min(self.share(), 1.0 - self.share())
        if self.wave == "square" and shorter_mm < SHORTEST_PERIOD_MM:
            raise ValueError(
                f"keys 'duty' and 'period_mm' make a part of {shorter_mm:g} mm, less than"
                f" {SHORTEST_PERIOD_MM:g} mm"
            )
        return self

    def finest_mm(self) -> float:
        return self.period_mm

    def share(self) -> float:
        """`duty`, or what it is where nobody says: half a period high, a whole period rising."""
        return (
            self.duty
            if self.duty is not None
            else {"sine": 0.5, "square": 0.5, "sawtooth": 1.0}[self.wave]
        )


class NoiseDescription(_Detailed):
    """Waves of every direction and of lengths between two limits, with random phases; a tile that
    has no seam.
    """

    kind: Literal["noise"]
    mean_cof: Cof = Field(description="middle of the two frictions")
    amplitude_cof: AmplitudeCof = Field(description="how far friction goes from the middle")
    shortest_mm: PeriodMm = Field(description="shortest wave")
    longest_mm: PeriodMm = Field(description="longest wave")
    tile_mm: PeriodMm = Field(
        default=32.0, description="side of the tile that repeats without a seam"
    )
    stretch: Annotated[float, Field(ge=1.0, le=100.0)] = Field(
        default=1.0, description="how much longer everything is along y than along x"
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        default=1, description="of the random phases"
    )
    rotation_deg: Degrees = Field(
        default=0.0, description="of the whole, from x towards y, which points down"
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        require_swing(self.mean_cof, self.amplitude_cof)
        if not self.shortest_mm < self.longest_mm <= self.tile_mm / 2.0:
            raise ValueError(
                f"shortest_mm {self.shortest_mm:g}, longest_mm {self.longest_mm:g} and half of"
                f" tile_mm {self.tile_mm:g} do not increase in that order"
            )
        if self.pixels() > LARGEST_NOISE_PIXELS:
            most_mm = LARGEST_NOISE_PIXELS * self.shortest_mm / SAMPLES_PER_WAVE
            raise ValueError(
                f"key 'tile_mm': at most {most_mm:.4g} for a shortest_mm of {self.shortest_mm:g}"
            )
        return self

    def finest_mm(self) -> float:
        return self.shortest_mm

    def pixels(self) -> int:
        """Pixels along each side of the tile."""
        return math.ceil(SAMPLES_PER_WAVE * self.tile_mm / self.shortest_mm)


class ProcessDescription(Checked, strict=True, allow_inf_nan=False):
    """The spectrum at one speed and load: that of y[n] + ar[0] y[n-1] + ... = noise[n] + ma[0]
    noise[n-1] + ...

    Either side must die away: all zeros of both polynomials lie inside the unit circle.
    """

    speed_mm_s: Annotated[float, Field(ge=0.0, le=1000.0)] = Field(
        description="of the finger whose spectrum this is"
    )
    normal_force_n: Annotated[float, Field(ge=0.0, le=20.0)] = Field(description="of that finger")
    cof_rms: AmplitudeCof = Field(description="friction (rms) in all nine bands")
    ar: Coefficients = Field(
        description="as `ar` above; all zeros of the polynomial inside the unit circle"
    )
    ma: Coefficients | None = Field(default=None, description="as `ma` above; likewise")

    @model_validator(mode="after")
    def _dies_away(self) -> Self:
        for name, given in (("ar", self.ar), ("ma", self.ma or [])):
            if not all(abs(reflection) < 1.0 for reflection in reflections(given).tolist()):
                raise ValueError(f"key '{name}' has a zero on or outside the unit circle")
        return self


class SpectrumDescription(_Detailed):
    """Waves along a direction whose spectrum, for a finger at a speed, is given in the nine bands
    from 12.5 to 800 Hz.

    In one of four ways. The friction (rms) of each band. The friction of all of them, shared out by
    a beta distribution over the logarithm of frequency. Or that of a process y[n] + ar[0] y[n-1] +
    ... = noise; or such processes for several speeds and loads, between which the texture changes
    with the finger. `perceptual_gain` multiplies all waves; `invert_finger` each by what a usual
    finger loses of it.
    """

    kind: Literal["spectrum"]
    mean_cof: Cof = Field(description="middle of the two frictions")
    band_cof_rms: (
        Annotated[list[AmplitudeCof], Field(min_length=BANDS, max_length=BANDS)] | None
    ) = Field(
        default=None,
        description=(
            "friction (rms) in each of the nine bands; this, or `beta` or `ar` with `cof_rms`"
        ),
    )
    cof_rms: AmplitudeCof | None = Field(
        default=None, description="friction (rms) in all nine bands"
    )
    beta: Annotated[list[Shape], Field(min_length=2, max_length=2)] | None = Field(
        default=None,
        description="shape numbers of a beta distribution over the logarithm of frequency",
    )
    ar: Coefficients | None = Field(
        default=None,
        description=(
            "coefficients of an autoregressive process, from the one of the sample before on"
        ),
    )
    ma: Coefficients | None = Field(
        default=None,
        description="coefficients of what drives that process, likewise; none: plain noise",
    )
    process: (
        Annotated[list[ProcessDescription], Field(min_length=1, max_length=MOST_PROCESSES)] | None
    ) = None
    rate_hz: Annotated[float, Field(ge=100.0, le=100e3)] | None = Field(
        default=None, description="samples per second of that process, or of all of `[[process]]`"
    )
    speed_mm_s: Annotated[float, Field(ge=LOWEST_SPEED_MM_S, le=1000.0)] = Field(
        default=50.0,
        description=(
            "of the finger for whom the spectrum is meant; its frequencies go "
            "with the speed. With `[[process]]` only where nobody says another, "
            "as in pictures"
        ),
    )
    normal_force_n: Annotated[float, Field(gt=0.0, le=20.0)] = Field(
        default=0.5,
        description="the load where nobody says another, as in pictures; only for `[[process]]`",
    )
    perceptual_gain: Gain = Field(default=1.0, description="by which all waves are multiplied")
    invert_finger: bool = Field(
        default=False,
        description="whether each wave is as much larger as a usual finger makes it smaller",
    )
    tile_mm: PeriodMm = Field(
        default=64.0, description="side of the tile that repeats without a seam"
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        default=1, description="of the random phases"
    )
    direction_deg: Degrees = Field(default=0.0, description="from x towards y, which points down")

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        forms = [
            name
            for name in ("band_cof_rms", "beta", "ar", "process")
            if getattr(self, name) is not None
        ]
        if len(forms) != 1:
            raise ValueError(
                "a spectrum has one of band_cof_rms, beta, ar and process, not"
                f" {', '.join(forms) or 'none'}"
            )
        form = forms[0]
        if (self.cof_rms is not None) != (form in ("beta", "ar")):
            raise ValueError("key 'cof_rms' goes together with beta or ar, and with nothing else")
        if (self.rate_hz is not None) != (form in ("ar", "process")):
            raise ValueError(
                "key 'rate_hz' goes together with ar or process, and with nothing else"
            )
        if self.ma is not None and form != "ar":
            raise ValueError("key 'ma' goes together with ar, and with nothing else")
        if len({(len(one.ar), len(one.ma or [])) for one in self.process or []}) > 1:
            raise ValueError("tables 'process' have unequal numbers of coefficients")
        least_mm = LEAST_WAVES * self.speed_mm_s / float(EDGES_HZ[0])
        most_mm = (LONGEST_TABLE_ROWS - 1) * self.finest_mm() / SAMPLES_PER_WAVE
        if not least_mm <= self.tile_mm <= most_mm:
            raise ValueError(
                f"key 'tile_mm': {least_mm:.4g} to {most_mm:.4g} for a speed_mm_s of"
                f" {self.speed_mm_s:g}"
            )
        return self

    def speeds_mm_s(self) -> tuple[float, float]:
        """The lowest and the highest speed that have waves of their own: the tile is too short for
        higher ones.
        """
        if self.process is None:
            return self.speed_mm_s, self.speed_mm_s
        given = [one.speed_mm_s for one in self.process]
        highest = min(
            max(*given, LOWEST_SPEED_MM_S), self.tile_mm * float(EDGES_HZ[0]) / LEAST_WAVES
        )
        return min(max(min(given), LOWEST_SPEED_MM_S), highest), highest

    def finest_mm(self) -> float:
        return max(self.speeds_mm_s()[0] / float(EDGES_HZ[-1]), FINEST_WAVE_MM)

    def points(self) -> int:
        return math.ceil(SAMPLES_PER_WAVE * self.tile_mm / self.finest_mm())


class _Located(_Detailed):
    """Where a texture's point 0, 0 lies, and what is beyond its ends."""

    file: FileName = Field(description="beside the texture's own file")
    origin_mm: OriginMm = Field([0.0, 0.0], description="where the texture's point 0, 0 lies")
    outside: Outside = Field(default="nothing", description="what is beyond its ends")


class ProfileDescription(_Located):
    """Points along a direction, in a CSV file with columns position_mm (or position_m) and cof.

    `perceptual_gain` is for friction recorded on a real surface. People took its playback for the
    original where it was 3 times (fine textures) to 5 times (coarse ones) too strong
    (10.1109/TOH.2021.3130091). The file keeps the friction as recorded.
    """

    kind: Literal["profile"]
    direction_deg: Degrees = Field(default=0.0, description="from x towards y, which points down")
    perceptual_gain: Gain = Field(
        default=1.0,
        description="by which friction's deviation from its mean along the line is multiplied",
    )


class MapDescription(_Located):
    """A picture of friction.

    `pitch_mm` is one number, or one each for x and y. With `cof_black` and `cof_white` the file
    holds 0 to 1 of full scale; without them, an array file holds cof itself.
    """

    kind: Literal["map"]
    pitch_mm: PitchMm = Field(
        description="from pixel to pixel: one number, or one each for x and y"
    )
    cof_black: Cof | None = Field(
        default=None, description="friction of black; goes together with `cof_white`"
    )
    cof_white: Cof | None = Field(default=None, description="friction of white")
    rotation_deg: Degrees = Field(
        default=0.0, description="of the whole, from x towards y, which points down"
    )

    @model_validator(mode="after")
    def _scale_is_whole(self) -> Self:
        if (self.cof_black is None) != (self.cof_white is None):
            raise ValueError("cof_black and cof_white go together")
        return self

    def scale(self) -> tuple[float, float] | None:
        """Friction of black and of white, or None where the file holds friction itself."""
        if self.cof_black is None or self.cof_white is None:
            return None
        return self.cof_black, self.cof_white

    def pitch_m(self) -> tuple[float, float]:
        """Pitch along x and along y."""
        x_mm, y_mm = self.pitch_mm
        return x_mm * 1e-3, y_mm * 1e-3


class HjifDescription(_Located):
    """The friction of an MPEG .hjif file; `cof_low` and `cof_high` are what its amplitudes 0 and 1
    mean.
    """

    kind: Literal["hjif"]
    cof_low: Cof = Field(description="friction of amplitude 0")
    cof_high: Cof = Field(description="friction of amplitude 1")
    direction_deg: Degrees = Field(default=0.0, description="from x towards y, which points down")


class StepDescription(_Description):
    """One step of a script: a friction or the name of a texture, from a time on."""

    time_s: Seconds = Field(description="from the start of the script")
    cof: Cof | None = Field(default=None, description="friction from then on; this or `texture`")
    texture: FileName | None = Field(
        default=None, description="name of a texture, or a file beside the script"
    )
    interpolation: Interpolation | None = Field(
        default=None, description="on the way to the next step"
    )
    label: Annotated[str, Field(max_length=200)] = Field(
        default="", description="written into the recording"
    )

    @model_validator(mode="after")
    def _has_one_target(self) -> Self:
        if (self.cof is None) == (self.texture is None):
            raise ValueError("a step has either a cof or a texture")
        return self


class ScriptDescription(_Description):
    """Steps by the clock, here or in a CSV file; `interpolation` is for steps that do not say."""

    kind: Literal["script"]
    file: FileName | None = Field(default=None, description="beside the texture's own file")
    step: Annotated[list[StepDescription], Field(min_length=2)] | None = None
    interpolation: Interpolation = Field(
        default="hold", description="between steps, where they do not say themselves"
    )

    @model_validator(mode="after")
    def _has_one_source(self) -> Self:
        if (self.file is None) == (self.step is None):
            raise ValueError("a script has either the key 'file' or tables [[step]]")
        return self


TextureDescription = (
    UniformDescription
    | GratingDescription
    | NoiseDescription
    | SpectrumDescription
    | ProfileDescription
    | MapDescription
    | HjifDescription
)
Description = TextureDescription | SceneDescription | ScriptDescription

SCRIPT_HINT = (
    "columns: time_s (rising), cof or texture, and optional label and interpolation (hold, linear,"
    " cosine)"
)


class _TextureFile(RootModel[Annotated[Description, Field(discriminator="kind")]]):
    """A file is one description, of the kind that it says."""


def parse(content: dict[str, Any], path: Path) -> Description:
    """The description in a texture file's content; `path` is for the error, which names every key
    at fault.
    """
    return config.parse(_TextureFile, content, str(path), "bad_texture").root


def parse_step(content: dict[str, Any], where: str) -> StepDescription:
    """One step of a script from a file's line, which `where` names in the error."""
    try:
        return config.parse(StepDescription, content, where)
    except BadInputError as error:
        raise BadInputError("bad_script", error.message, SCRIPT_HINT) from None
