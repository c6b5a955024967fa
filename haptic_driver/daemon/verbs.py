"""What clients may ask of the daemon, each defined once, in `Verbs`. An entry there gives the route
of the API, the method of the Python client, the command of `haptic` and its page.

A request is a record with its ranges, and is checked where it arrives, by the API.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, Signature
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Concatenate,
    Generic,
    Literal,
    ParamSpec,
    Protocol,
    Self,
    TypeVar,
    cast,
    overload,
)

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, JsonValue

from haptic_driver.config import PRINTABLE
from haptic_driver.daemon import messages
from haptic_driver.daemon.messages import SOMEBODY, Asked, Lease, Query, Status, TileRequest, Why
from haptic_driver.textures.objects import Change

if TYPE_CHECKING:  # a client does not wait for what a daemon imports
    from haptic_driver.daemon.daemon import Daemon

    AnyPath = str | Path  # as a client may give it
else:
    AnyPath = str

# what turns into JSON in a few milliseconds, of which the set-point pump loses as many
MOST_SAMPLES = 2000
MOST_CHANGES = 1000  # of a scene at once

Since = Annotated[int, Field(ge=0, le=2**62, description="Only what comes after this number.")]
Nearest = Annotated[
    bool, Field(description="Render the nearest that is reachable, however far off it is.")
]


# --- how a client writes a value


@dataclass(frozen=True)
class Written:
    """As metadata of a field: what a client sends for what was said, None where nothing was.

    `kind`: of the files in configs that the value may name.
    """

    of: Callable[[Any], object]
    kind: str = ""


def whole_path(path: str | Path | None) -> str | None:
    """The daemon runs in another folder."""
    return None if path is None else str(Path(path).absolute())


def named_from_anywhere(name: str) -> str:
    """The absolute path where a path is given; a name stays a name."""
    path = Path(name)
    is_path = bool(path.suffix) or len(path.parts) > 1
    return str(path.absolute()) if is_path and os.path.isfile(path) else name


def _who(holder: str | None) -> str:
    """This program's name and process, where nobody is named."""
    program = "".join(c for c in Path(sys.argv[0]).name[:60] if c.isprintable()) or "python"
    return holder or f"{program}, process {os.getpid()}"


TextureName = Annotated[
    str,
    Field(
        min_length=1, max_length=200, description="Texture: a name in configs/textures or a path."
    ),
    Written(named_from_anywhere, "textures"),
]
ModelName = Annotated[
    str,
    Field(min_length=1, max_length=1000, description="Model: a name in configs/models or a path."),
    Written(named_from_anywhere, "models"),
]


# --- what is said with a request


class Empty(Asked):
    """For what needs no more words."""


class Request(Asked):
    """Base of what a client sends as JSON: a number is a number, neither `true` nor text."""

    model_config = ConfigDict(strict=True)


class FrictionChoice(Request):
    """`haptic set MU`; more than 10 % out of reach at the present load it is refused, unless
    `nearest` will do.
    """

    # At most twice what a texture file may say.
    cof: Annotated[
        FiniteFloat, Field(gt=0.0, le=10.0, description="Coefficient of friction to render.")
    ]
    nearest: Nearest = False


class TextureChoice(Request):
    """`haptic texture play T`; refused when more than half of it is as far out of reach, unless
    `nearest` will do.
    """

    name: TextureName
    nearest: Nearest = False


class SceneChange(Request):
    """`haptic scene`: changes in order, which take effect together between two ticks.

    The first since arming begins a scene. After the output was switched off a scene is changed
    without being rendered, until somebody says `show`. `nearest` as for textures.
    """

    changes: Annotated[list[Change], Field(max_length=MOST_CHANGES)] = Field(default=[])
    show: Annotated[bool, Field(description="Render the scene, also after OFF.")] = False
    nearest: Nearest = False


class LoadChoice(Request):
    """`haptic load hold 0.5`; refused outside what the rig's file allows."""

    newtons: Annotated[FiniteFloat, Field(gt=0.0, le=20.0, description="Load to hold, N.")]


class ModelChoice(Request):
    """`haptic use MODEL`; without `carrier_hz` the carrier is chosen as the rig's file says."""

    name: ModelName
    carrier_hz: Annotated[
        Annotated[FiniteFloat, Field(gt=0.0)] | None,
        Field(description="Hz, in place of what the rig's file has chosen."),
    ] = None
    feedback: Annotated[
        bool, Field(description="Hold friction by what is felt, or go by the model alone.")
    ] = True


class Adapt(Request):
    """`haptic adapt on` and `haptic adapt off`."""

    on: Annotated[
        bool, Field(description="on: refit from here on. off: go back to the model as it was.")
    ]


class ArmRequest(Request):
    """`haptic arm`."""

    lease_s: Annotated[FiniteFloat, Field(ge=0.1, le=60.0)] = 0.5
    holder: Annotated[
        str, Field(min_length=1, max_length=100, pattern=PRINTABLE), Written(_who)
    ] = SOMEBODY


class RecordingRequest(Request):
    """`haptic record FILE`; null stops. With the token of a lease it ends 2 s after that, and null
    stops no other.
    """

    path: Annotated[
        Annotated[AnyPath, Field(min_length=1, max_length=1000, pattern=PRINTABLE)] | None,
        Written(whole_path),
    ]
    lease: Annotated[str, Field(min_length=1, max_length=100)] | None = None


class Mark(Request):
    """`haptic mark LABEL`: something that happened, in the words of whoever saw it."""

    label: Annotated[str, Field(min_length=1, max_length=200, pattern=PRINTABLE)]
    data: dict[str, JsonValue] = Field(default={})


class WhyRequest(Request):
    """`haptic why`: by what was rendered in the last `minutes`, as far as it is kept."""

    minutes: Annotated[FiniteFloat, Field(gt=0.0, le=1440.0)] = 1440.0


class SinceEvent(Query):
    """The query of `GET /events`."""

    since: Since = 0


class SinceTick(Query):
    """The query of `GET /samples`."""

    since: Since = 0
    most: Annotated[int, Field(ge=1, le=MOST_SAMPLES, description="The newest so many.")] = 1000


# --- a verb

Words = ParamSpec("Words")
Said = TypeVar("Said", bound=Asked)
Answer = TypeVar("Answer", bound=BaseModel)


class Client(Protocol):
    """Who asks the daemon."""

    def ask(self, verb: Verb[..., Any, Answer], said: dict[str, Any], token: str = "") -> Answer:
        """What the daemon answers; `token` is the lease's."""


class Holder(Client, Protocol):
    """A client that holds a lease."""

    token: str


@dataclass(frozen=True)
class Verb(Generic[Words, Said, Answer]):
    """One request: where it goes, what it carries, what is answered, and what it does, in words
    too. `asked` is the body of a POST, or the query of a GET. As an attribute of a client it is a
    method.

    The lease's token is the last argument of `do`, which is empty for others than `Leased`. Where
    `do` gives nothing, the status is the answer. `switches_off`: never waits for a thread that
    another request holds. `slow`: may wait for a process to start. `command`: of `haptic`, with a
    name in capitals for each required field, and an `example` of its arguments. `name`: in the API,
    where it is not that of the method.
    """

    method: Literal["GET", "POST"]
    path: str
    asked: Callable[Words, Said]
    answer: type[Answer]
    do: Callable[[Daemon, Said, str], Answer | None]
    said: str
    switches_off: bool = False
    slow: bool = False
    command: str = ""
    example: str = "--json"
    name: str = ""

    @property
    def schema(self) -> type[Asked]:
        """The record of what is asked."""
        return cast(type[Asked], self.asked)

    def said_json(self, daemon: Daemon, asked: Said, token: str) -> str:
        """Ask the daemon; its answer as JSON."""
        return (self.do(daemon, asked, token) or daemon.status()).model_dump_json()

    @overload
    def __get__(self, client: None, owner: type) -> Self: ...
    @overload
    def __get__(self, client: Client, owner: type) -> Callable[Words, Answer]: ...
    def __get__(self, client: Any, owner: type) -> Any:
        return self if client is None else self._asking(client)

    def _asking(self, client: Client, *first: Parameter) -> Callable[..., Answer]:
        """A function that asks; its arguments are those in `first` and the fields."""
        fields = self.schema.__signature__.parameters.values()
        taken = (field.replace(kind=Parameter.POSITIONAL_OR_KEYWORD) for field in fields)
        signature = Signature([*first, *taken])

        def ask(*values: object, **named: object) -> Answer:
            said = signature.bind(*values, **named).arguments
            return client.ask(self, said, *(said.pop(p.name) for p in first))

        ask.__doc__, ask.__signature__ = self.said, signature  # type: ignore[attr-defined]
        return ask


@dataclass(frozen=True)
class Leased(Verb[Words, Said, Answer]):
    """A request with the lease's token, which is the first argument for who does not hold one."""

    @overload  # type: ignore[override]
    def __get__(self, client: None, owner: type) -> Self: ...
    @overload
    def __get__(self, client: Holder, owner: type) -> Callable[Words, Answer]: ...
    @overload
    def __get__(self, client: Client, owner: type) -> Callable[Concatenate[str, Words], Answer]: ...
    def __get__(self, client: Any, owner: type) -> Any:
        if client is None:
            return self
        token = Parameter("token", Parameter.POSITIONAL_ONLY)
        return self._asking(client, *([] if hasattr(client, "token") else [token]))


def _samples(daemon: Daemon, asked: SinceTick, _token: str) -> messages.SampleColumns:
    from haptic_driver.daemon.web.frames import sample_columns  # noqa: PLC0415  (numpy)

    return messages.SampleColumns.model_construct(
        sample_columns(daemon.samples(asked.since, asked.most))
    )


def _carrier(daemon: Daemon, *_: object) -> messages.CarrierRule:
    from haptic_driver.textures.bands import EDGES_HZ  # noqa: PLC0415  (numpy)

    controller = daemon.basis.settings.config.controller
    return messages.CarrierRule(
        quiet_above_hz=controller.quiet_above_hz, bands_hz=EDGES_HZ.tolist()
    )


class Verbs:
    """The table. A client of the daemon inherits it."""

    arm = Verb(
        "POST",
        "/arm",
        ArmRequest,
        Lease,
        lambda daemon, asked, _: daemon.arm(asked.lease_s, asked.holder),
        "Idle to armed. The lease is to be renewed within `lease_s`, or the output ramps to zero.",
    )
    renew = Leased(
        "POST",
        "/renew",
        Empty,
        Lease,
        lambda daemon, _, token: daemon.renew(token),
        "Keep the lease alive.",
    )
    set = Leased(
        "POST",
        "/set",
        FrictionChoice,
        Status,
        lambda daemon, asked, token: daemon.targets.set(token, asked.cof, nearest=asked.nearest),
        "Ask for one friction everywhere; armed to rendering. Renews the lease.",
        command="set MU",
        example="0.6",
        name="set_target",
    )
    play = Leased(
        "POST",
        "/texture",
        TextureChoice,
        Status,
        lambda daemon, asked, token: daemon.targets.play(token, asked.name, nearest=asked.nearest),
        "Ask for a texture; armed to rendering. Renews the lease.",
        slow=True,
        command="texture play NAME",
        example="linen",
    )
    change_scene = Leased(
        "POST",
        "/scene",
        SceneChange,
        messages.SceneChanged,
        lambda daemon, asked, token: daemon.targets.change_scene(
            token, asked.changes, show=asked.show, nearest=asked.nearest
        ),
        "Add, move, turn, set and remove objects of a scene, all at one tick. Renews the lease.",
        slow=True,
    )
    hold_load = Leased(
        "POST",
        "/load",
        LoadChoice,
        Status,
        lambda daemon, asked, token: daemon.hold_load(token, asked.newtons),
        "Have the load stage press the finger and hold a load; answers at once. It lets go when it"
        " is told to, at OFF, and with the lease. Renews the lease.",
    )
    release_load = Verb(
        "POST",
        "/load/release",
        Empty,
        Status,
        lambda daemon, *_: daemon.release_load(),
        "Have the load stage let go, from anyone; the output stays as it is.",
        command="load release",
    )
    off = Verb(
        "POST",
        "/off",
        Empty,
        Status,
        lambda daemon, *_: daemon.off(),
        "Output to zero at once, from anyone, in any state; rendering to armed.",
        switches_off=True,
        command="off",
    )
    disarm = Verb(
        "POST",
        "/disarm",
        Empty,
        Status,
        lambda daemon, *_: daemon.disarm(),
        "Off, and the lease ends; from anyone.",
        switches_off=True,
        command="disarm",
    )
    reset = Verb(
        "POST",
        "/reset",
        Empty,
        Status,
        lambda daemon, *_: daemon.reset(),
        "Acknowledge a fault or trip whose cause is gone; fault to idle.",
        command="reset",
    )
    use_model = Verb(
        "POST",
        "/model",
        ModelChoice,
        Status,
        lambda daemon, asked, _: daemon.use_model(
            asked.name, asked.carrier_hz, feedback=asked.feedback
        ),
        "Render by another model, such as one of the finger that is there now, at one carrier or"
        " without feedback; while idle. Takes about a second.",
        slow=True,
        command="use MODEL",
        example="reference --carrier 2000",
    )
    adapt = Verb(
        "POST",
        "/adapt",
        Adapt,
        Status,
        lambda daemon, asked, _: daemon.adapt(asked.on),
        "Refit the finger's model from measured friction while it renders, or restore the model.",
        command="adapt MODE",
        example="on",
    )
    ask_why = Verb(
        "POST",
        "/why",
        WhyRequest,
        Why,
        lambda daemon, asked, _: daemon.basis.why(asked.minutes),
        "Begin to diagnose what was rendered so far: where friction and model disagree, and which"
        " effect is missing.",
    )
    record = Verb(
        "POST",
        "/record",
        RecordingRequest,
        Status,
        lambda daemon, asked, _: daemon.record(asked.path, asked.lease),
        "Record into a file on the daemon's machine, or stop with null.",
        slow=True,
    )
    mark = Verb(
        "POST",
        "/mark",
        Mark,
        messages.Marked,
        lambda daemon, asked, _: daemon.mark(asked.label, asked.data),
        "Write a marker among the events, and so into the recording; from anyone.",
    )
    status = Verb(
        "GET",
        "/status",
        Empty,
        Status,
        lambda daemon, *_: daemon.status(),
        "The present state.",
        command="status",
    )
    texture_names = Verb(
        "GET",
        "/textures",
        Empty,
        messages.TextureNames,
        lambda daemon, *_: messages.TextureNames(
            textures=daemon.textures(), scripts=daemon.scripts()
        ),
        "Names that `/texture` knows.",
        name="textures",
    )
    events_since = Verb(
        "GET",
        "/events",
        SinceEvent,
        messages.Events,
        lambda daemon, asked, _: messages.Events(events=list(daemon.events(asked.since))),
        "What happened after event `since`, as far back as it is kept.",
        name="events",
    )
    sample_columns = Verb(
        "GET",
        "/samples",
        SinceTick,
        messages.SampleColumns,
        _samples,
        "Ticks after tick `since`, one list per field, oldest first.",
        name="samples",
    )
    surface = Verb(
        "GET",
        "/surface",
        Empty,
        messages.SurfaceMap,
        lambda daemon, *_: messages.SurfaceMap(**daemon.surface_map()),
        "Friction over frequency and voltage.",
    )
    texture = Verb(
        "GET",
        "/texture",
        Empty,
        messages.TextureMap,
        lambda daemon, *_: messages.TextureMap(**daemon.texture_map()),
        "Friction over the screen, of the texture that plays.",
    )
    scene_shown = Verb(
        "GET",
        "/scene",
        Empty,
        messages.SceneShown,
        lambda daemon, *_: daemon.targets.scene_shown(),
        "The present scene with its objects.",
    )
    tile = Verb(
        "GET",
        "/tile",
        TileRequest,
        messages.Tile,
        lambda daemon, asked, _: daemon.tile(asked),
        "A part of a texture of the library as it is felt, averaged where it is finer than a cell.",
    )
    model_names = Verb(
        "GET",
        "/models",
        Empty,
        messages.ModelNames,
        lambda daemon, *_: messages.ModelNames(models=daemon.models()),
        "Names that `/model` knows.",
        name="models",
    )
    why = Verb(
        "GET",
        "/why",
        Empty,
        Why,
        lambda daemon, *_: daemon.basis.inquiry.answer,
        "What the last such diagnosis says.",
    )
    why_page = Verb(
        "GET",
        "/why/page",
        Empty,
        messages.WhyPage,
        lambda daemon, *_: messages.WhyPage(html=daemon.basis.inquiry.page()),
        "Its report with pictures.",
    )
    carrier = Verb(
        "GET",
        "/carrier",
        Empty,
        messages.CarrierRule,
        _carrier,
        "Where the ripple at twice the carrier is felt, and the bands in which it may lie.",
    )


def all_verbs() -> dict[str, Verb[..., Any, Any]]:
    """Every entry of the table by its name in the API."""
    return {verb.name or attribute: verb for attribute, verb in methods().items()}


def methods() -> dict[str, Verb[..., Any, Any]]:
    """Every entry by its name in Python, and on the command channel."""
    return {name: verb for name, verb in vars(Verbs).items() if isinstance(verb, Verb)}


def commands() -> dict[str, Verb[..., Any, Any]]:
    """The verbs that are commands of `haptic` as they stand, by its words."""
    verbs = [verb for verb in all_verbs().values() if verb.command]
    return {" ".join(filter(str.islower, verb.command.split())): verb for verb in verbs}
