"""The participant's page in a real browser: an experiment's questions are shown, and answered
once.
"""

import threading

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.lab.psychophysics.answers import MarkerParticipant
from haptic_driver.lab.psychophysics.run import Question
from haptic_driver.lab.psychophysics.schedule import Trial
from tests.haptic_driver.daemon.web.served_page import HANG_MS, expect, opened

pytestmark = pytest.mark.process

QUESTION = Question(
    1,
    "Which one had more friction?",
    ("first", "second"),
    Trial(1, 1, "a", 0.1, 0, False, False),
    0.1,
)


@pytest.fixture
def client(served, control):
    with HapticClient(served.socket) as client:
        yield client


@pytest.fixture
def page(browser, served, control):
    """Only then: a page that had heard what was asked before waited for numbers that begin anew
    with the control.
    """
    context = browser.new_context(viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.set_default_timeout(HANG_MS)
    page.goto(served.url.replace("/page/", "/page/participant.html"))
    yield page
    context.close()


def answering(work):
    found = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    return thread, found


def answers(client):
    return [event.data for event in client.events() if event.message == "answer"]


def test_the_daemons_page_leads_to_it_and_hands_on_the_token(browser, served, client):
    dashboard = opened(browser, served)
    with dashboard.expect_popup() as popup:
        dashboard.click("#participant")
    page = popup.value
    thread, _ = answering(lambda: MarkerParticipant(client).wait("Slide to and fro."))
    expect(page.locator("#text")).to_have_text("Slide to and fro.", timeout=HANG_MS)
    page.click("#answers button")
    thread.join()
    dashboard.context.close()


@pytest.mark.parametrize(
    "data", [{"text": "?", "answers": "no list"}, {"text": "?"}, {"text": 1, "answers": ["a"]}]
)
def test_a_question_that_cannot_be_shown_leaves_no_buttons_of_the_last(page, client, data):
    client.mark("question", {"text": "Which?", "answers": ["first", "second"]})
    expect(page.locator("#answers button")).to_have_count(2)
    client.mark("question", data)
    expect(page.locator("#answers button")).to_have_count(0)
    expect(page.locator("#text")).to_have_text("Please wait: this question cannot be shown.")
    assert answers(client) == []


def test_a_participant_reads_feels_and_answers_with_large_buttons_or_keys(page, client):
    participant = MarkerParticipant(client)
    thread, _ = answering(lambda: participant.wait("Slide to and fro."))
    expect(page.locator("#text")).to_have_text("Slide to and fro.")
    page.click("#answers button")
    thread.join()

    client.mark("trial begins", {"trial": 1})
    expect(page.locator("#text")).to_have_text("Get ready.")
    expect(page.locator("#answers button")).to_have_count(0)
    client.mark("interval 1 begins", {"interval": 1, "of": 2, "sound": False})
    expect(page.locator("#text")).to_have_text("1: slide your finger on the screen.")
    client.mark("interval 1 ends", {"interval": 1, "of": 2})
    expect(page.locator("#text")).to_have_text("Wait.")
    client.mark("interval 2 begins")
    expect(page.locator("#text")).to_have_text("2: slide your finger on the screen.")
    thread, found = answering(lambda: participant.ask(QUESTION))
    expect(page.locator("#text")).to_have_text("Which one had more friction?")
    boxes = [button.bounding_box() for button in page.locator("#answers button").all()]
    assert [button.text_content() for button in page.locator("#answers button").all()] == [
        "first",
        "second",
    ]
    for box in boxes:
        assert box["width"] >= 120
        assert box["height"] >= 150
        assert box["x"] + box["width"] <= 390
    page.keyboard.press("2")
    page.keyboard.press("1")
    thread.join()
    assert found == [1]
    assert [data["answer"] for data in answers(client)] == ["go on", "second"]
    participant.tell("Right.")
    expect(page.locator("#told")).to_have_text("Right.")


def test_an_only_interval_has_no_number(page, client):
    client.mark("interval 1 begins", {"interval": 1, "of": 1, "sound": False})
    expect(page.locator("#text")).to_have_text("Slide your finger on the screen.")
    client.mark("interval 1 ends", {"interval": 1, "of": 1})
    expect(page.locator("#text")).to_have_text("…")


def test_an_interval_sounds_where_the_experiment_says_so(page, client):
    page.evaluate(
        """() => { window.tones = []; const start = OscillatorNode.prototype.start;
        OscillatorNode.prototype.start = function () { tones.push(this.frequency.value); start.call(this); }; }"""
    )
    for number, sound in ((1, False), (2, True)):
        client.mark(f"interval {number} begins", {"interval": number, "of": 2, "sound": sound})
    expect(page.locator("#text")).to_have_text("2: slide your finger on the screen.")
    assert page.evaluate("tones") == [880]


def test_nothing_on_the_page_gives_the_answer_away(page, client):
    """What the markers of a trial say of level, place and felt friction is nowhere in the DOM."""
    secrets = {"level": 0.13579, "condition": "at0.55secret", "position": 2, "cof": 0.62468}
    client.mark("trial begins", {"trial": 7531, "practice": False, **secrets})
    seen = [page.content()]
    expect(page.locator("#text")).to_have_text("Get ready.")
    for number in (1, 2):
        which = {"interval": number, "of": 2, "sound": False, **secrets, "onset_s": 86420.5}
        client.mark(f"interval {number} begins", which)
        expect(page.locator("#text")).to_contain_text(f"{number}: slide")
        seen.append(page.content())
        client.mark(f"interval {number} ends", which)
        expect(page.locator("#text")).to_have_text("Wait." if number == 1 else "…")
        seen.append(page.content())
    thread, _ = answering(lambda: MarkerParticipant(client).ask(QUESTION))
    expect(page.locator("#answers button")).to_have_count(2)
    seen.append(page.content())
    shown = page.evaluate(
        "() => [document.title, ...[...document.querySelectorAll('*')].flatMap("
        "(one) => [...one.attributes].map(({ value }) => value))].join(' ')"
    )
    page.keyboard.press("1")
    thread.join()
    client.mark("trial ends", {"trial": 7531, "response": "first", **secrets})
    seen += [page.content(), shown]
    for html in seen:
        for secret in ("13579", "secret", "62468", "7531", "86420"):
            assert secret not in html
        assert "position" not in html


def test_stop_takes_the_output_away_and_says_so(page, client, control):
    lease = client.arm(60.0)
    client.set(lease.token, 0.6)
    page.click("#stop")
    expect(page.locator("#text")).to_have_text("Stopped. The screen is off.")
    assert client.status().output_on is False
    control.shown_off = False
    page.click("#stop")
    expect(page.locator("#text")).to_contain_text("Take your finger off the screen")
