"""Answers over the daemon: a page or another program that hears questions and answers them by
markers.
"""

import threading

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.errors import HapticError
from haptic_driver.lab.psychophysics.answers import GO_ON, MarkerParticipant
from haptic_driver.lab.psychophysics.run import Question
from haptic_driver.lab.psychophysics.schedule import Trial
from tests.haptic_driver.daemon.bench_control import BenchControl, serving
from tests.waiting import until

TRIAL = Trial(1, 1, "a", 0.1, 0, False, False)
QUESTION = Question(1, "Which one?", ("first", "second"), TRIAL, 0.1)


@pytest.fixture
def client(tmp_path):
    with serving(BenchControl(), tmp_path), HapticClient(tmp_path / "d.sock") as client:
        yield client


def in_thread(work):
    found = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    return thread, found


def asked(client, count):
    """The markers `question` so far, once there are so many."""

    def questions():
        return [event for event in client.events() if event.message == "question"]

    until(lambda: len(questions()) >= count)
    return questions()


def test_only_an_answer_to_this_question_counts(client):
    client.mark("second")  # before anybody asked
    thread, found = in_thread(lambda: MarkerParticipant(client).ask(QUESTION))
    (question,) = asked(client, 1)
    assert question.data == {"text": "Which one?", "answers": ["first", "second"]}
    client.mark("answer", {"question": question.number - 1, "answer": "first"})
    client.mark("answer", {"question": question.number, "answer": "third"})
    client.mark("answer", {"answer": ["first"]})
    client.mark("trial begins", {"answer": "first"})
    client.mark("answer", {"question": question.number, "answer": "second"})
    thread.join()
    assert found == [1]


def test_a_label_alone_answers_as_lsl_would(client):
    participant = MarkerParticipant(client)
    thread, found = in_thread(lambda: (participant.wait("A break."), participant.ask(QUESTION)))
    (rest,) = asked(client, 1)
    assert rest.data == {"text": "A break.", "answers": [GO_ON]}
    client.mark(GO_ON)
    asked(client, 2)
    client.mark("first")
    thread.join()
    assert found == [(None, 0)]


def test_a_participant_who_stops_the_experiment_ends_the_wait(client):
    client.arm(60.0)
    told = []

    def ask():
        try:
            MarkerParticipant(client).ask(QUESTION)
        except HapticError as error:
            told.append(error)

    thread, _ = in_thread(ask)
    asked(client, 1)
    client.disarm()
    thread.join()
    assert told[0].code == "stopped"
    assert told[0].message == "disarmed"
