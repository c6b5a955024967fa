"""What clients may ask of the daemon, each said once: the routes of its API and its Python client
follow from this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from pydantic import BaseModel

from haptic_driver.config import Checked
from haptic_driver.daemon import messages
from haptic_driver.daemon.messages import Lease, Status

if TYPE_CHECKING:  # a client does not wait for what a daemon imports
    from haptic_driver.daemon.daemon import Daemon


class Empty(Checked):
    """For what needs no more words."""


Asked = TypeVar("Asked", bound=Checked)
Answer = TypeVar("Answer", bound=BaseModel)


@dataclass(frozen=True)
class Verb(Generic[Asked, Answer]):
    """One request: where it goes, what it says (`asked`: the body of a POST, the query of a GET),
    what is answered.

    `leased`: the lease's token comes with it, and is the last argument of `do`, which is empty for
    others. `switches_off`: never waits for a thread that another request holds.
    """

    name: str
    method: Literal["GET", "POST"]
    path: str
    asked: type[Asked]
    answer: type[Answer]
    do: Callable[[Daemon, Asked, str], Answer]
    said: str
    leased: bool = False
    switches_off: bool = False

    def said_json(self, daemon: Daemon, asked: Asked, token: str) -> str:
        """Ask the daemon; its answer as JSON."""
        return self.do(daemon, asked, token).model_dump_json()


def _samples(daemon: Daemon, asked: messages.SinceTick, token: str) -> messages.SampleColumns:
    from haptic_driver.daemon.web.frames import sample_columns  # noqa: PLC0415  (numpy)

    return messages.SampleColumns.model_construct(
        sample_columns(daemon.samples(asked.since, asked.most))
    )


ARM = Verb(
    "arm",
    "POST",
    "/arm",
    messages.ArmRequest,
    Lease,
    lambda daemon, asked, _: daemon.arm(asked.lease_s, asked.holder),
    "Idle to armed. The lease is to be renewed within `lease_s`, or the output ramps to zero.",
)
RENEW = Verb(
    "renew",
    "POST",
    "/renew",
    Empty,
    Lease,
    lambda daemon, _, token: daemon.renew(token),
    "Keep the lease alive.",
    leased=True,
)
SET = Verb(
    "set_target",
    "POST",
    "/set",
    messages.FrictionChoice,
    Status,
    lambda daemon, asked, token: daemon.set_target(token, asked.cof, nearest=asked.nearest),
    "Ask for one friction everywhere; armed to rendering. Renews the lease.",
    leased=True,
)
PLAY = Verb(
    "play",
    "POST",
    "/texture",
    messages.TextureChoice,
    Status,
    lambda daemon, asked, token: daemon.play(token, asked.name, nearest=asked.nearest),
    "Ask for a texture; armed to rendering. Renews the lease.",
    leased=True,
)
OFF = Verb(
    "off",
    "POST",
    "/off",
    Empty,
    Status,
    lambda daemon, *_: daemon.off(),
    "Output to zero at once, from anyone, in any state; rendering to armed.",
    switches_off=True,
)
DISARM = Verb(
    "disarm",
    "POST",
    "/disarm",
    Empty,
    Status,
    lambda daemon, *_: daemon.disarm(),
    "Off, and the lease ends; from anyone.",
    switches_off=True,
)
RESET = Verb(
    "reset",
    "POST",
    "/reset",
    Empty,
    Status,
    lambda daemon, *_: daemon.reset(),
    "Acknowledge a fault or trip whose cause is gone; fault to idle.",
)
USE_MODEL = Verb(
    "use_model",
    "POST",
    "/model",
    messages.ModelChoice,
    Status,
    lambda daemon, asked, _: daemon.use_model(
        asked.name, asked.carrier_hz, feedback=asked.feedback
    ),
    "Render by another model, such as one of the finger that is there now, at one carrier or"
    " without feedback; while idle. Takes about a second.",
)
ADAPT = Verb(
    "adapt",
    "POST",
    "/adapt",
    messages.Adapt,
    Status,
    lambda daemon, asked, _: daemon.adapt(asked.on),
    "Mend the finger's model while it renders, by what is felt; or go back to the model as it was.",
)
RECORD = Verb(
    "record",
    "POST",
    "/record",
    messages.RecordingRequest,
    Status,
    lambda daemon, asked, _: daemon.record(asked.path, asked.lease),
    "Record into a file on the daemon's machine, or stop with null.",
)
MARK = Verb(
    "mark",
    "POST",
    "/mark",
    messages.Mark,
    messages.Marked,
    lambda daemon, asked, _: daemon.mark(asked.label, asked.data),
    "Write a marker among the events, and so into the recording; from anyone.",
)
ASK_WHY = Verb(
    "ask_why",
    "POST",
    "/why",
    messages.WhyRequest,
    messages.Why,
    lambda daemon, asked, _: daemon.ask_why(asked.minutes),
    "Begin to diagnose what was rendered so far: where friction and model disagree, and which"
    " effect is missing.",
)
WHY = Verb(
    "why",
    "GET",
    "/why",
    Empty,
    messages.Why,
    lambda daemon, *_: daemon.basis.inquiry.answer,
    "What the last such diagnosis says.",
)
WHY_PAGE = Verb(
    "why_page",
    "GET",
    "/why/page",
    Empty,
    messages.WhyPage,
    lambda daemon, *_: messages.WhyPage(html=daemon.basis.inquiry.page()),
    "Its report with pictures.",
)
STATUS = Verb(
    "status",
    "GET",
    "/status",
    Empty,
    Status,
    lambda daemon, *_: daemon.status(),
    "The present state.",
)
TEXTURES = Verb(
    "textures",
    "GET",
    "/textures",
    Empty,
    messages.TextureNames,
    lambda daemon, *_: messages.TextureNames(textures=daemon.textures(), scripts=daemon.scripts()),
    "Names that `/texture` knows.",
)
EVENTS = Verb(
    "events",
    "GET",
    "/events",
    messages.SinceEvent,
    messages.Events,
    lambda daemon, asked, _: messages.Events(events=list(daemon.events(asked.since))),
    "What happened after event `since`, as far back as it is kept.",
)
SAMPLES = Verb(
    "samples",
    "GET",
    "/samples",
    messages.SinceTick,
    messages.SampleColumns,
    _samples,
    "Ticks after tick `since`, one list per field, oldest first.",
)
SURFACE = Verb(
    "surface",
    "GET",
    "/surface",
    Empty,
    messages.SurfaceMap,
    lambda daemon, *_: messages.SurfaceMap(**daemon.surface_map()),
    "Friction over frequency and voltage.",
)
TEXTURE = Verb(
    "texture",
    "GET",
    "/texture",
    Empty,
    messages.TextureMap,
    lambda daemon, *_: messages.TextureMap(**daemon.texture_map()),
    "Friction over the screen, of the texture that plays.",
)
TILE = Verb(
    "tile",
    "GET",
    "/tile",
    messages.TileRequest,
    messages.Tile,
    lambda daemon, asked, _: daemon.tile(asked),
    "A part of a texture of the library as it is felt, averaged where it is finer than a cell.",
)
MODELS = Verb(
    "models",
    "GET",
    "/models",
    Empty,
    messages.ModelNames,
    lambda daemon, *_: messages.ModelNames(models=daemon.models()),
    "Names that `/model` knows.",
)

COMMANDS: tuple[Verb[Any, Any], ...] = (
    ARM,
    RENEW,
    SET,
    PLAY,
    OFF,
    DISARM,
    RESET,
    USE_MODEL,
    ADAPT,
    ASK_WHY,
    RECORD,
    MARK,
)
VIEWS: tuple[Verb[Any, Any], ...] = (
    STATUS,
    TEXTURES,
    EVENTS,
    SAMPLES,
    SURFACE,
    TEXTURE,
    TILE,
    MODELS,
    WHY,
    WHY_PAGE,
)
