"""What an experiment's file says: conditions, how a trial goes, what is answered, by which method
levels are chosen.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, FiniteFloat, model_validator

from haptic_driver.config import URL, Section, find_config, parse
from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.functions import Form
from model.support.errors import nearest
from model.support.reading import read_bytes, read_toml


def _plain(name: str) -> str:
    if name != name.strip() or not name.isprintable():
        raise ValueError("a name is one line that neither begins nor ends with a space")
    return name


Name = Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_plain)]
Level = Annotated[FiniteFloat, Field(ge=-10.0, le=10.0)]
Above0 = Annotated[FiniteFloat, Field(gt=0.0, le=10.0)]
Share = Annotated[FiniteFloat, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1, le=10_000)]
HIGHEST_LAPSE = 0.1


class Stimulus(NamedTuple):
    """What one interval asks for: a friction everywhere, or a texture."""

    cof: float | None
    texture: str | None = None


class Constant(Section):
    """Constant stimuli: every level as often as the others, in random order."""

    kind: Literal["constant"]
    levels: Annotated[list[Level], Field(min_length=1)] = Field(description="that are presented")
    repeats: Count = Field(default=10, description="of every level")


class Staircase(Section):
    """`down` positive answers in a row: a step down; `up` negative ones: a step up.

    `steps`: one after each reversal, then the last; `scale` `linear` adds it, `ratio` multiplies by
    1 + it. It ends after so many reversals, or trials. The mean of the last `averaged` reversals is
    its own estimate.
    """

    kind: Literal["staircase"]
    start: Level = Field(description="first level")
    steps: Annotated[list[Above0], Field(min_length=1)] = Field(
        description="after each reversal the next; the last stays"
    )
    scale: Literal["linear", "ratio"] = Field(
        default="ratio", description="a step multiplies, or adds"
    )
    up: Annotated[int, Field(ge=1, le=10)] = Field(
        default=1, description="negative answers in a row before a step up"
    )
    down: Annotated[int, Field(ge=1, le=10)] = Field(
        default=2, description="positive answers in a row before a step down"
    )
    low: Level = Field(description="lowest level")
    high: Level = Field(description="highest level")
    reversals: Count = Field(default=10, description="after so many it ends")
    averaged: Count = Field(default=6, description="the last so many make its own estimate")
    trials: Count = Field(default=100, description="it ends after so many at the latest")

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if not self.low <= self.start <= self.high:
            raise ValueError("start must lie within low to high")
        if self.scale == "ratio" and self.low <= 0.0:
            raise ValueError('scale = "ratio" needs a low above 0')
        return self


class Range(Section):
    """Values evenly spaced on a logarithmic axis (`normal` functions: a linear one for thresholds
    and levels).
    """

    low: Level = Field(description="lowest")
    high: Level = Field(description="highest")
    count: Annotated[int, Field(ge=2, le=200)] = Field(default=40, description="how many")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low >= self.high:
            raise ValueError("low must be below high")
        return self


class QuestPlus(Section):
    """QUEST+: each level is the one whose answer is expected to tell most of threshold, slope and
    lapses.

    It ends after `trials`, or once the standard deviation of the threshold is below `stop_std`, a
    share of it.
    """

    kind: Literal["quest_plus"]
    levels: Range
    thresholds: Range
    slopes: Annotated[list[Above0], Field(min_length=1)] = Field(
        default=[1.5, 2.0, 3.0, 4.5], description="that may be"
    )
    lapses: Annotated[
        list[Annotated[float, Field(ge=0.0, le=HIGHEST_LAPSE)]], Field(min_length=1)
    ] = Field(default=[0.0, 0.02, 0.05], description="that may be")
    trials: Count = Field(default=60, description="it ends after so many at the latest")
    stop_std: Annotated[FiniteFloat, Field(ge=0.0, le=1.0)] = Field(
        default=0.0,
        description="ends earlier when the threshold is known to this share of itself; 0: never",
    )


class Outside(Section):
    """Somebody else's: a Python class `module:Class`, or a server at `url`; see `outside.py`."""

    kind: Literal["outside"]
    python: str | None = Field(default=None, description="an optimiser of yours, `module:Class`")
    url: Annotated[str, Field(pattern=URL)] | None = Field(
        default=None,
        description="of an optimiser's server ([both](experiments.md#a-method-of-your-own))",
    )
    trials: Count = Field(default=1000, description="it ends after so many at the latest")

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.python is None) == (self.url is None):
            raise ValueError("give either python or url")
        return self


Method = Annotated[Constant | Staircase | QuestPlus | Outside, Field(discriminator="kind")]


class Comparison(Section):
    """The texture that stands for a level."""

    level: Level = Field(description="the level")
    texture: str = Field(description="that stands for it, by name or path")


class Condition(Section):
    """A standard, and what a level makes of it.

    A friction `cof` is compared with cof (1 + level), or with cof + level where `compare` is
    `difference`. A texture is compared with those of `comparisons`, of which the nearest level is
    taken.
    """

    name: Name = Field(description="any words; in tables and pictures")
    cof: Annotated[FiniteFloat, Field(gt=0.0, le=5.0)] | None = Field(
        default=None, description="friction of the standard; this or `texture`"
    )
    texture: str | None = Field(
        default=None, description="texture of the standard, by name or path"
    )
    compare: Literal["ratio", "difference"] = Field(
        default="ratio",
        description="what a level is: a share of the standard, or an addition to it",
    )
    comparisons: list[Comparison] = []  # noqa: RUF012

    @model_validator(mode="after")
    def _one_standard(self) -> Self:
        if (self.cof is None) == (self.texture is None):
            raise ValueError("give either cof or texture")
        if (self.texture is None) == bool(self.comparisons):
            raise ValueError("comparisons are the textures that a texture is compared with")
        return self

    @property
    def axis(self) -> str:
        """What a level is, as an axis says it."""
        if self.cof is None:
            return "level of the texture, as the file numbers it"
        if self.compare == "difference":
            return f"friction above {self.cof:g}"
        return f"friction above {self.cof:g}, as a share of it"

    @property
    def standard(self) -> Stimulus:
        """What the comparison is compared with."""
        return Stimulus(self.cof, self.texture)

    def available(self, level: float) -> float:
        """The nearest level that there is."""
        return min((c.level for c in self.comparisons), key=lambda x: abs(x - level), default=level)

    def comparison(self, level: float) -> Stimulus:
        """What a level, one that is available, stands for."""
        if self.cof is None:
            return Stimulus(None, next(c.texture for c in self.comparisons if c.level == level))
        return Stimulus(self.cof * (1.0 + level) if self.compare == "ratio" else self.cof + level)

    def level_between(self, standard_cof: float, comparison_cof: float) -> float:
        """The level of two frictions, such as those that were felt."""
        difference = comparison_cof - standard_cof
        return difference / standard_cof if self.compare == "ratio" else difference


class Block(Section):
    """Conditions whose trials are mixed; there is a break between blocks."""

    conditions: Annotated[list[Name], Field(min_length=1)] = Field(
        description="whose trials are mixed"
    )


class TrialSettings(Section):
    """How a trial goes: so many intervals, of which one has the comparison and the others the
    standard.

    With 1 the answer is yes or no. `place` `regions`: two frictions at once, left and right of
    `middle_mm`. An interval lasts `duration_s`, or until the finger has made `strokes`, at most
    `most_s`.
    """

    intervals: Annotated[int, Field(ge=1, le=4)] = Field(
        default=2, description="1: yes or no; more: which one had the comparison"
    )
    place: Literal["time", "regions"] = Field(
        default="time",
        description="intervals one after the other, or left and right half of the screen at once",
    )
    middle_mm: Annotated[FiniteFloat, Field(ge=0.0, le=1000.0)] = Field(
        default=50.0, description="x of the border between the halves"
    )
    duration_s: Annotated[FiniteFloat, Field(ge=0.1, le=600.0)] = Field(
        default=2.0, description="of an interval"
    )
    strokes: Annotated[int, Field(ge=0, le=100)] = Field(
        default=0,
        description="an interval lasts until the finger has made so many; 0: `duration_s`",
    )
    most_s: Annotated[FiniteFloat, Field(ge=0.1, le=600.0)] = Field(
        default=20.0, description="an interval with `strokes` lasts no longer"
    )
    pause_s: Annotated[FiniteFloat, Field(ge=0.0, le=60.0)] = Field(
        default=0.5, description="between intervals, with the output off"
    )
    load_n: Annotated[FiniteFloat, Field(ge=0.01, le=10.0)] | None = Field(
        default=None, description="the load stage presses anew for each interval, and holds this"
    )
    sound: bool = Field(
        default=False,
        description=(
            "a tone on the participant's page, or the terminal's bell, as an interval begins"
        ),
    )

    @model_validator(mode="after")
    def _two_regions(self) -> Self:
        if self.place == "regions" and self.intervals != 2:
            raise ValueError('place = "regions" has 2 intervals')
        return self


class Response(Section):
    """What is asked, the possible answers, the key of each answer, and whether people learn what
    was right.

    `by` `markers`: answers come over the daemon, from its page or any program; see `answers.py`.
    """

    by: Literal["keys", "markers"] = Field(
        default="keys",
        description=(
            "keys of the terminal, or markers over the daemon ([who "
            "answers](experiments.md#who-answers))"
        ),
    )

    question: str = Field(
        default="Which one had more friction?", description="asked after every trial"
    )
    answers: list[Annotated[str, Field(min_length=1, max_length=40)]] = Field(
        default=[], description="empty: first, second, ...; left, right; yes, no"
    )
    keys: list[Annotated[str, Field(min_length=1, max_length=1)]] = Field(
        default=[], description="empty: 1, 2, ..."
    )
    feedback: bool = Field(
        default=False, description="whether the participant is told what was right"
    )


class Delivery(Section):
    """When the rig has done what was asked. In every interval the finger slid for `least_sliding_s`
    after `settle_s`, and friction was within 5 % for `least_share` of that. Other trials are
    presented anew, `retries` times in a row.
    """

    settle_s: Annotated[FiniteFloat, Field(ge=0.0, le=10.0)] = Field(
        default=0.2, description="at the beginning of an interval, not judged"
    )
    least_sliding_s: Annotated[FiniteFloat, Field(ge=0.0, le=600.0)] = Field(
        default=0.3, description="the finger must slide for so long"
    )
    least_share: Share = Field(
        default=0.5, description="of that time within 5 % of the friction asked for"
    )
    retries: Annotated[int, Field(ge=0, le=100)] = Field(
        default=5, description="trials in a row that may fail; one more ends the run"
    )


class Analysis(Section):
    """The psychometric function that is fitted: `weibull` over levels from 0 on, `normal` over
    levels of both signs.

    `guess` is 1/intervals, or 0 for `normal`, unless given; for yes and no it is found.
    """

    form: Form = Field(default="weibull", description="shape of the psychometric function")
    guess: Share | None = Field(
        default=None, description="share of positive answers without a difference"
    )


class SimulatedParticipant(Section):
    """Somebody whose threshold is known."""

    threshold: Level = Field(
        default=0.15, description="the level at which its function is half way"
    )
    slope: Above0 = Field(default=3.0, description="of its function")
    lapse: Annotated[float, Field(ge=0.0, le=HIGHEST_LAPSE)] = Field(
        default=0.02, description="share of answers at random"
    )


class ExperimentFile(Section):
    """An experiment. `seed` and the participant's name decide every order."""

    name: Name = Field(
        description="any words; result files have its letters and digits in their names"
    )
    about: str = Field(default="", description="in words")
    instructions: str = Field(
        default="", description="what the participant reads before the first trial"
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        default=1, description="of every order, with the participant's and the session's names"
    )
    practice: Annotated[int, Field(ge=0, le=1000)] = Field(
        default=0,
        description="trials before the first that count; the participant is told what was right",
    )
    practice_level: Level | None = Field(default=None, description="their level")
    break_every: Annotated[int, Field(ge=0, le=10_000)] = Field(
        default=0, description="so many trials; 0: breaks only between blocks"
    )
    block_order: Literal["as_written", "random", "balanced"] = Field(
        default="as_written",
        description=(
            "random: each participant's own; balanced: by the number in the name, "
            "every block as often in every place and after every other"
        ),
    )
    trial: TrialSettings = TrialSettings()
    response: Response = Response()
    delivery: Delivery = Delivery()
    analysis: Analysis = Analysis()
    simulated: SimulatedParticipant = SimulatedParticipant()
    method: Method
    condition: Annotated[list[Condition], Field(min_length=1)]
    block: list[Block] = []  # noqa: RUF012

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        names = [c.name for c in self.condition]
        if len(set(names)) < len(names):
            raise ValueError("two conditions have the same name")
        for name in (name for block in self.block for name in block.conditions):
            if name not in names:
                raise ValueError(f"block: there is no condition '{name}'. {nearest(name, names)}")
        if self.trial.place == "regions" and any(c.cof is None for c in self.condition):
            raise ValueError('place = "regions" is for frictions')
        count = max(self.trial.intervals, 2)
        for what, said in (("answers", self.response.answers), ("keys", self.response.keys)):
            if said and len(set(said)) != count:
                raise ValueError(f"response.{what}: give {count} different ones")
        if self.practice and self.practice_level is None:
            raise ValueError("practice needs a practice_level")
        return self


DEFAULT_ANSWERS = {1: ("yes", "no"), 2: ("first", "second"), 3: ("first", "second", "third")}
DEFAULT_ANSWERS[4] = (*DEFAULT_ANSWERS[3], "fourth")
REGION_ANSWERS = ("left", "right")


@dataclass(frozen=True)
class Experiment:
    """An experiment's file, read; `content_hash` is SHA-256 of it."""

    file: ExperimentFile
    path: Path
    content_hash: str

    @property
    def answers(self) -> Sequence[str]:
        """What may be answered: in the intervals' order; for one interval the first is the positive
        one.
        """
        trial = self.file.trial
        default = REGION_ANSWERS if trial.place == "regions" else DEFAULT_ANSWERS[trial.intervals]
        return tuple(self.file.response.answers) or default

    @property
    def keys(self) -> Sequence[str]:
        """The key of each answer."""
        return tuple(self.file.response.keys) or tuple(str(i + 1) for i in range(len(self.answers)))

    @property
    def guess(self) -> float | None:
        """Share of positive answers without any difference; None where it is to be found."""
        analysis, intervals = self.file.analysis, self.file.trial.intervals
        if analysis.guess is not None or intervals == 1:
            return analysis.guess
        return 0.0 if analysis.form == "normal" else 1.0 / intervals

    def condition(self, name: str) -> Condition:
        """One of its conditions."""
        return next(c for c in self.file.condition if c.name == name)

    @property
    def blocks(self) -> list[list[str]]:
        """The conditions of each block; all in one where the file names none."""
        return [b.conditions for b in self.file.block] or [[c.name for c in self.file.condition]]

    @property
    def textures(self) -> list[str]:
        """Those that it presents."""
        named = [
            t for c in self.file.condition for t in (c.texture, *(x.texture for x in c.comparisons))
        ]
        return list(dict.fromkeys(t for t in named if t is not None))


def load_experiment(name_or_path: str) -> Experiment:
    """An experiment by the name of its file in `configs/experiments/`, or by path. BadInputError
    says what is wrong.
    """
    path = find_config(name_or_path, "experiments")
    content = read_bytes(path)
    experiment = Experiment(
        parse(ExperimentFile, read_toml(path), str(path)), path, hashlib.sha256(content).hexdigest()
    )
    for condition in experiment.file.condition:
        _check_levels(experiment, condition)
    return experiment


def asked_levels(method: Method) -> tuple[float, float] | None:
    """The lowest and the highest level that a method may present; None where nobody knows."""
    match method:
        case Constant(levels=levels):
            return min(levels), max(levels)
        case Staircase(low=low, high=high) | QuestPlus(levels=Range(low=low, high=high)):
            return low, high
    return None


def _check_levels(experiment: Experiment, condition: Condition) -> None:
    """BadInputError for levels that are no friction, or that the function does not know."""
    ends = asked_levels(experiment.file.method)
    if ends is None:
        return
    where = f"{experiment.path}: condition {condition.name}"
    if experiment.file.analysis.form == "weibull" and ends[0] < 0.0:
        said = f"{where}: level {ends[0]:g} is below 0, which a Weibull function does not know"
        raise BadInputError(
            "bad_config", said, 'Give levels from 0 on, or [analysis] form = "normal"'
        )
    for level in ends if condition.cof is not None else ():
        friction = condition.comparison(level).cof
        if friction is None or not 0.0 < friction <= 10.0:
            said = f"{where}: level {level:g} makes friction {friction:g}"
            raise BadInputError(
                "bad_config", said, "Give levels that leave a friction above 0, at most 10"
            )
