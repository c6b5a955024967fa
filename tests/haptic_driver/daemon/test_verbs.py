"""One entry in the table of verbs is a route, a method of the client, a command and a row of the
page on the API.
"""

from __future__ import annotations

import importlib
from inspect import signature
from pathlib import Path
from typing import Annotated

import httpx
import pytest
from pydantic import Field, FiniteFloat

from haptic_driver.client import HapticClient
from haptic_driver.config import Checked
from haptic_driver.daemon.verbs import Leased, Request, Verb, Verbs
from haptic_driver.errors import BadInputError
from hw.errors import DeviceTimeout
from model.support.errors import ModelError
from tests.haptic_driver.daemon.bench_control import BenchControl, serving

DOCS = Path(__file__).resolve().parents[3] / "docs"


class Push(Request):
    """How a finger is pushed."""

    force_n: Annotated[FiniteFloat, Field(gt=0.0, le=2.0, description="How hard, in newtons.")]
    gently: Annotated[bool, Field(description="Slowly too.")] = False


class Pushed(Checked):
    """What came of it."""

    token: str
    force_n: float
    gently: bool


@pytest.fixture
def socket(monkeypatch, tmp_path):
    """A daemon that knows one more verb."""
    verb = Leased(
        "POST",
        "/push",
        Push,
        Pushed,
        lambda daemon, asked, token: Pushed(token=token, **asked.model_dump()),
        "Push the finger.",
        command="push FORCE",
        example="0.5 --gently",
    )
    monkeypatch.setattr(Verbs, "push", verb, raising=False)
    monkeypatch.setenv("HAPTIC_SOCKET", str(tmp_path / "d.sock"))
    with serving(BenchControl(), tmp_path):
        (tmp_path / "d.sock.lease").write_text("held")
        yield tmp_path / "d.sock"


def test_it_is_a_method_of_the_client(socket):
    with HapticClient(socket) as client:
        said = client.push("mine", 0.5, gently=True)
        assert said.model_dump() == {"token": "mine", "force_n": 0.5, "gently": True}
        assert list(signature(client.push).parameters) == ["token", "force_n", "gently"]
        assert client.push.__doc__ == "Push the finger."


def test_it_is_a_command_with_help(socket, haptic):
    assert haptic("push", "0.5", "--gently", "--json").said == {
        "token": "held",
        "force_n": 0.5,
        "gently": True,
    }
    shown = " ".join(haptic("push", "--help").out.split())
    assert "{FORCE}" in shown
    assert "Push the finger." in shown
    assert "How hard, in newtons." in shown
    assert "Slowly too." in shown
    assert "Example: haptic push 0.5 --gently" in shown
    assert "Push the finger." in haptic("--help").out


@pytest.mark.usefixtures("socket")
def test_it_is_on_the_page_about_the_api(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    parts = importlib.import_module("reference").api()
    assert "### `POST /push`\n\nPush the finger." in parts["requests"]
    assert (
        "| `force_n` | number, > 0, ≤ 2 | N | always there | How hard, in newtons. |"
        in parts["records"]
    )


def test_what_is_out_of_range_is_refused_in_the_same_words_everywhere(socket, haptic):
    said = "force_n: Input should be less than or equal to 2, not 3.0"
    with HapticClient(socket) as client, pytest.raises(BadInputError) as refused:
        client.push("mine", 3.0)
    assert (refused.value.code, refused.value.message) == ("out_of_range", said)
    done = haptic("push", "3", "--json")
    assert (done.status, done.said["error"]["message"]) == (2, said)
    with httpx.Client(transport=httpx.HTTPTransport(uds=str(socket)), base_url="http://h") as http:
        assert http.post("/push", json={"force_n": 3.0}).json()["error"]["message"] == said


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (DeviceTimeout("the generator is silent", "look at it"), 409, "device_timeout"),
        (ModelError("skin is missing", "give it"), 422, "bad_model"),
    ],
)
def test_what_fails_beneath_is_told_with_its_own_code(monkeypatch, tmp_path, error, status, code):
    def fail(*_):
        raise error

    monkeypatch.setattr(Verbs, "push", Verb("POST", "/push", Push, Pushed, fail, ""), raising=False)
    with serving(BenchControl(), tmp_path):
        transport = httpx.HTTPTransport(uds=str(tmp_path / "d.sock"))
        with httpx.Client(transport=transport, base_url="http://h") as http:
            answer = http.post("/push", json={"force_n": 0.5})
    assert answer.status_code == status
    assert answer.json()["error"] == error.content
    assert error.code == code
