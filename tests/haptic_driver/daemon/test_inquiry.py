"""A diagnosis of what was rendered, in a process of its own."""

from pathlib import Path

import pytest

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.inquiry import LEAST_ROWS, Inquiry
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.live import why
from haptic_driver.live.window import Window
from tests.waiting import until

pytestmark = pytest.mark.process

UNDRIVEN = [
    Window(0.0, 0.0, 0.5, 0.03, 0.5, 0.01, 5000.0 + k, 1.0, 1, k + 1) for k in range(LEAST_ROWS)
]


@pytest.fixture
def inquiry():
    inquiry = Inquiry(EventLog())
    yield inquiry
    inquiry.close()


def answered(inquiry):
    until(lambda: inquiry.answer.state != "running")
    return inquiry.answer


def test_what_was_rendered_is_diagnosed_and_its_report_is_gone_in_the_end(inquiry):
    """Without a voltage nothing can be tested, which is soon said."""
    assert inquiry.ask(UNDRIVEN, "reference", simulated=True).state == "running"
    with pytest.raises(RefusedError) as refused:
        inquiry.ask(UNDRIVEN, "reference", simulated=True)
    assert refused.value.code == "running"
    answer = answered(inquiry)
    assert (answer.state, answer.verdict, answer.rows) == ("done", "not_testable", LEAST_ROWS)
    assert "cannot test the model" in answer.said
    assert "cannot test the model" in inquiry.page()
    assert Path(answer.report).parent.stat().st_mode & 0o077 == 0
    inquiry.close()
    assert not Path(answer.report).exists()


def test_too_few_rows_and_a_failure_are_said(inquiry):
    with pytest.raises(RefusedError, match=f"{LEAST_ROWS - 1} rows"):
        inquiry.ask(UNDRIVEN[1:], "reference", simulated=True)
    with pytest.raises(RefusedError, match="nobody has asked yet"):
        inquiry.page()
    failed = why.answer("no such model", Path("nowhere"))
    assert (failed["state"], failed["said"].partition(".")[0]) == (
        "failed",
        "there is no model named 'no such model'",
    )
