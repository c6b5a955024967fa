"""The page as its users use it: what it asks of the daemon, says of it, and never hides."""

import time
from datetime import datetime

import pytest

from haptic_driver.daemon.messages import AgreementCell, InstrumentStatus, LoadPhase, LoadStatus
from haptic_driver.processes.samples import Flag
from haptic_driver.textures.bands import EDGES_HZ
from haptic_driver.textures.ripple import ripple
from hw.health import Health
from tests.haptic_driver.daemon.bench_control import FIDELITY
from tests.haptic_driver.daemon.web.served_page import (
    BrowserError,
    arm,
    arm_and_set,
    expect,
    load,
    opened,
    press_grey,
    tab,
    text,
)
from tests.waiting import until

pytestmark = pytest.mark.process

TILES_ASKED = (
    "performance.getEntriesByType('resource').filter((one) => one.name.includes('/tile?')).length"
)
PLOTS = ["friction", "surface", "trail"]


PART_S = 0.5  # half of what the page takes for silence


@pytest.fixture
def hurried(browser, served, control):
    """A page of its own, and a function that lets time pass for it and for the daemon."""
    page = tab(browser)
    page.clock.install()
    load(page, served)

    def let_pass(duration_s):
        for _ in range(round(duration_s / PART_S)):
            told = control.ticks
            control.ahead_s += PART_S
            page.clock.fast_forward(round(1e3 * PART_S))
            until(lambda told=told: page.evaluate("1") and control.ticks > told)

    yield page, let_pass
    page.context.close()


def await_state(served, state):
    return until(lambda: (status := served.ask("/status"))["state"] == state and status)


def pixels(page, plot):
    return page.evaluate(f"document.getElementById('{plot}').toDataURL()")


def await_change(page, plot):
    before = pixels(
        page, plot
    )  # the page forbids scripts made of strings, so nothing in it can wait for us
    until(lambda: pixels(page, plot) != before, lambda: f"{plot} stands still")


def test_it_loads_without_complaint_and_asks_nobody_else(page, served):
    text(page, "#state", "IDLE")
    text(page, "#output", "OFF")
    expect(page.locator("#simulated")).to_be_visible()
    expect(page.locator("#textures label")).to_have_count(5)
    expect(page.locator("#textures .script")).to_have_attribute("data-name", "steps")
    text(page, "#events li .kind", "state")
    until(lambda: page.evaluate(TILES_ASKED) > 4)  # thumbnails, and what is selected
    assert page.complaints == []
    origin = served.url.partition("/page/")[0]
    assert len(page.requested) >= 6
    assert [url for url in page.requested if not url.startswith((origin + "/", "data:"))] == []


def test_the_token_does_not_stay_in_the_address(page, served):
    assert served.token not in page.url
    page.reload()
    text(page, "#link", "connected")


def test_a_page_without_the_token_says_that_it_is_not_connected(browser, served):
    context = browser.new_context()
    page = context.new_page()
    page.goto(served.url.partition("?")[0])
    text(page, "#link", "connection lost")
    expect(page.locator("#alarm")).to_contain_text("Connection to the daemon lost")
    context.close()


def test_the_plots_move(page):
    arm_and_set(page)
    for plot in PLOTS:
        page.locator(f"#{plot}").evaluate(
            "(one) => one.scrollIntoView()"
        )  # what nobody sees is not drawn
        await_change(page, plot)


@pytest.mark.parametrize(
    "switch_off", [lambda page: page.click("#off"), lambda page: page.keyboard.press("Escape")]
)
def test_off_switches_off(page, served, control, switch_off):
    arm_and_set(page)
    assert served.ask("/status")["output_on"] is True
    page.focus("#cof")
    switch_off(page)
    assert await_state(served, "armed")["output_on"] is False
    assert ("off",) in control.calls
    text(page, "#output", "OFF")


def test_off_needs_no_new_connection(page, served, control):
    """Where the port is crowded the open stream carries it; the page shows what has become of
    it.
    """
    arm_and_set(page)
    page.route("**/off", lambda route: route.abort())
    page.click("#off")
    assert await_state(served, "armed")["output_on"] is False
    assert ("off",) in control.calls
    text(page, "#output", "OFF")


def test_off_that_cannot_be_shown_is_not_called_off(page, control):
    arm_and_set(page)
    control.shown_off = False
    page.click("#off")
    text(page, "#output", "UNKNOWN")
    expect(page.locator("#refusal-message")).to_contain_text(
        "nothing shows yet that the output is off"
    )
    expect(page.locator("#alarm")).to_contain_text("emergency stop")


def test_a_texture_is_played_and_disarming_ends_the_lease(page, served):
    arm(page)
    page.check("#textures input[value=linen]", force=True)
    page.click("#play button")
    assert await_state(served, "rendering")["texture"] == "linen"
    page.click("#disarm")
    await_state(served, "idle")
    text(page, "#lease", "Nobody holds the lease.")


def test_the_page_renews_its_lease_and_leaving_it_disarms(hurried, served, control):
    page, let_pass = hurried
    arm_and_set(page, "5")
    for _ in range(6):  # five per lease
        before = control.calls.count(("renew",))
        let_pass(1.0)
        until(lambda before=before: page.evaluate("1") and control.calls.count(("renew",)) > before)
    assert served.ask("/status")["state"] == "rendering"
    page.goto("about:blank")
    await_state(served, "idle")


def test_refusals_are_shown_with_what_to_do(page, control):
    arm(page)
    page.fill("#cof", "7")
    page.click("#set button")
    text(page, "#refusal-message", "friction 7 is far out of reach")
    text(page, "#refusal-hint", "give nearest")
    page.click("#refusal-close")
    expect(page.locator("#refusal")).to_be_hidden()


def test_what_cannot_work_now_is_grey_and_says_why(page, control):
    expect(page.locator("#set button")).to_have_attribute("title", "Nobody has armed. Arm first.")
    press_grey(page, "#set button")
    text(page, "#refusal-message", "Nobody has armed. Arm first.")
    assert control.calls == []
    control.arm(60.0, "haptic, process 7")
    for button in ("#arm", "#set button", "#play button"):
        expect(page.locator(button)).to_have_attribute(
            "title", "haptic, process 7 holds the lease. Disarm it, or wait for it to end."
        )
    expect(page.locator("#lease")).to_contain_text("Held by haptic, process 7")
    expect(page.locator("#disarm")).to_be_enabled()
    page.click("#disarm")
    text(page, "#lease", "Nobody holds the lease.")


def test_the_lease_is_as_long_as_one_says_and_says_whose_it_is(page, served, control):
    arm(page, "30")
    assert ("arm", 30.0) in control.calls
    expect(page.locator("#lease")).to_contain_text("This page holds the lease of 30 s")
    assert served.ask("/status")["lease_holder"].startswith("a page (Chrome")


def test_a_renewal_that_is_not_heard_does_not_end_the_lease(hurried, control):
    page, let_pass = hurried
    lost = []

    def once(route):
        lost.append(route.request.url)
        route.abort() if len(lost) == 1 else route.continue_()

    page.route("**/renew", once)
    arm(page, "30")  # on a busy machine the daemon's clock goes on by more than is let pass
    let_pass(13.0)  # two renewals
    until(lambda: page.evaluate("1") and len(lost) > 1 and control.calls.count(("renew",)) >= 1)
    expect(page.locator("#lease")).to_contain_text("This page holds the lease")
    text(page, "#state", "ARMED")


def test_a_model_is_chosen_and_a_recording_begun_and_ended(page, served, control):
    page.select_option("#model", "other")
    page.click("#use button")
    until(lambda: served.ask("/status")["model"] == "other")
    page.fill("#path", "mine.h5")
    page.click("#record button")
    text(page, "#record button", "Stop")
    text(page, "#recording", "mine.h5")
    page.click("#record button")
    text(page, "#record button", "Record")
    assert [call for call in control.calls if call[0] == "record"] == [
        ("record", "mine.h5", None),
        ("record", None, None),
    ]


def test_which_interval_of_a_trial_runs_stands_above_the_screen(page, control):
    control.mark("interval 1 begins", {"interval": 1, "of": 2})
    text(page, "#interval", "interval 1 of 2")
    control.mark("interval 1 ends", {"interval": 1, "of": 2})
    text(page, "#interval", "")


def test_notes_and_markers_are_among_the_events(page, control):
    page.fill("#note", "the finger was wiped")
    page.click("#mark button")
    expect(page.locator("#events li").first).to_contain_text("the finger was wiped")
    expect(page.locator("#note")).to_have_value("")
    page.click("#mark button")
    until(lambda: [call for call in control.calls if call[0] == "mark"][1:])
    assert [call[1] for call in control.calls if call[0] == "mark"] == [
        "the finger was wiped",
        "mark",
    ]


def test_every_flag_has_a_meaning_and_says_since_when(page, control):
    control.tell("flag", "overrun")
    control.tell("flag", "overrun")
    control.flags = Flag(2**32 - 1).names()
    expect(page.locator("#flags li")).to_have_count(len(control.flags))
    said = page.locator("#flags li").all_inner_texts()
    assert not [words for words in said if "see the events" in words]
    (overrun,) = (words for words in said if "overrun" in words)
    assert "2 times" in overrun
    assert page.locator("#events li time").first.inner_text().partition(".")[0] in overrun


def test_events_have_the_time_on_the_wall(page, control):
    (event,) = control.told
    offset_s = time.time() - time.monotonic()
    said = page.locator("#events time").last.get_attribute("datetime")
    assert datetime.fromisoformat(said).timestamp() == pytest.approx(
        event.time_s + offset_s, abs=1.0
    )


def test_friction_is_bounded_by_what_is_within_reach(page):
    slider = page.locator("#cof-slider")
    expect(slider).to_have_attribute("min", "0.500")
    expect(slider).to_have_attribute("max", "0.900")
    slider.focus()
    page.keyboard.press("End")
    assert float(page.input_value("#cof")) == 0.9


def test_a_page_opened_while_a_texture_plays_shows_the_texture_itself(browser, control, served):
    """Not the coarse map of what is in no library: its name may come before those of the
    library.
    """
    control.play(control.arm(60.0, "a test").token, "linen", nearest=False)
    page = opened(browser, served)
    text(page, "#shown", "linen")
    text(page, "#chosen", "braille (linen plays)")  # what Play would play is another
    page.check("#textures input[value=linen]", force=True)
    text(page, "#chosen", "linen")
    page.context.close()


def test_a_page_whose_scripts_did_not_all_come_is_loaded_again(browser, served):
    """On a busy machine it once stayed as it was, "not connected"."""
    page = tab(browser)
    page.route("**/tiles.js", lambda route: route.abort(), times=1)
    load(page, served)
    page.context.close()


# Of the 5 s that an opening is waited for a tenth; the first one is never answered.
NEVER_OPEN = """
const later = setTimeout, Opens = WebSocket;
let opened = 0;
window.setTimeout = (work, ms) => later(work, ms === 5000 ? 500 : ms);
window.WebSocket = class extends Opens {
  constructor(address) {
    super(opened++ ? address : "ws://127.0.0.1:9/");
    if (opened === 1) Object.defineProperties(this, { onclose: {}, onerror: {} });
  }
};
"""


def test_a_connection_that_nobody_opens_is_tried_again(browser, served):
    page = tab(browser)
    page.add_init_script(NEVER_OPEN)
    load(page, served)
    page.context.close()


def test_a_paused_plot_stands_still_and_goes_on(page):
    await_change(page, "friction")
    page.click("#pause")
    text(page, "#pause", "Resume")
    await_change(page, "trail")  # a frame later: the moment of the pause is drawn
    before = pixels(page, "friction")
    for _ in range(2):
        await_change(page, "trail")  # samples go on
    assert pixels(page, "friction") == before
    page.click("#pause")
    await_change(page, "friction")


def test_a_paused_plot_stands_still_though_it_is_drawn_anew(page):
    """Also its last point, which takes in new samples for 1.5 s where ten minutes are shown."""
    page.check("#spans input[value='600']", force=True)
    page.click("#pause")
    text(page, "#pause", "Resume")
    before = pixels(page, "friction")
    for _ in range(10):
        await_change(page, "trail")
    for _ in range(3):  # through all themes, each of which draws everything
        page.click("#theme")
    assert pixels(page, "friction") == before


def test_the_surface_says_what_forbids_a_place_also_where_it_comes_after_the_pointer(page, served):
    held = []

    def hold(route):
        held.append(route)

    page.route("**/surface", hold)
    with page.expect_request("**/surface"):
        load(page, served)
    surface = page.locator("#surface")
    width = surface.bounding_box()["width"]
    surface.hover(position={"x": 0.8 * width, "y": 20.0})  # waits until the page stands still
    held[0].continue_()
    expect(page.locator("#surface-said")).to_contain_text(
        "forbidden by voltage (at most 40.0 V), slew rate (at most 30.0 V)"
    )
    surface.focus()
    for _ in range(40):
        page.keyboard.press("ArrowDown")
    expect(page.locator("#surface-said")).to_contain_text("allowed")


def test_the_carriers_ripple_is_said_while_there_is_any(page, served):
    """A carrier of 250 Hz, on a daemon whose rig takes ripples from 600 Hz on for quiet."""
    text(page, "#ripple", "–")
    arm_and_set(page)
    text(page, "#ripple", "500 Hz, in the band of 317 to 504 Hz: felt")
    page.click("#off")
    text(page, "#ripple", "–")


def test_the_page_judges_a_ripple_as_the_program_does(page):
    ask = "async ([hz, rule]) => (await import('./ripple.js')).rippleWords(hz, rule)"
    for carrier_hz, quiet_above_hz, said in (
        (5.0, 1000.0, "10 Hz, below the bands: felt"),
        (100.0, 200.0, "200 Hz, in the band of 200 to 317 Hz: not felt"),
        (419.87, 1000.0, "839.7 Hz, above the bands: felt"),
        (500.0, 1000.0, "1000 Hz, above the bands: not felt"),
    ):
        rule = {"quiet_above_hz": quiet_above_hz, "bands_hz": EDGES_HZ.tolist()}
        assert page.evaluate(ask, [carrier_hz, rule]) == said
        judged = ripple(carrier_hz, quiet_above_hz)
        assert said.endswith(": felt") is judged.felt
        assert said.partition(", ")[2].startswith(judged.place)


def test_the_score_and_the_bands_are_the_daemons_own(page, control):
    expect(page.locator("#bands li")).to_have_count(9)
    expect(page.locator("#bands li.unknown")).to_have_count(9)
    text(page, "#error", "–")
    control.fidelity = FIDELITY
    text(page, "#error", "1.4 %")
    text(page, "#score", FIDELITY.said[0])
    expect(page.locator("#score")).to_have_attribute("title", ".\n".join(FIDELITY.said))
    bands = page.locator("#bands li")
    kinds = [(bands.nth(i).get_attribute("class") or "") for i in range(9)]
    assert kinds == ["", "off", "off", "unknown", "", "unknown", "unknown", "unknown", "unknown"]
    said = [bands.nth(i).get_attribute("title") for i in (1, 3, 5, 8)]
    assert said[0] == "25 Hz: gain 1.30, coherence 0.90"
    assert said[1] == "63 Hz: too little is asked for, or too short a time"
    assert said[2] == "159 Hz: gain 0.66, coherence 0.10, above what this rig can do"
    assert said[3].endswith("Hz: above what this rig can do")
    heights = [bands.nth(i).locator("i").bounding_box()["height"] for i in (0, 1)]
    assert heights[1] / heights[0] == pytest.approx(1.3 / 0.91, rel=0.03)


def test_the_latency_is_said_as_measured_beside_the_budget(page, control):
    budget = "10.0 ms by the rig's file: tick 0.5"
    text(page, "#latency", f"{budget}; not measured: nobody has looked yet")
    control.latency = {"latency_measured_s": 0.0123, "latency_error_s": 0.0002}
    text(page, "#latency", f"12.3 ± 0.2 ms measured, {budget}")


def test_ticks_that_were_missed_long_ago_are_no_alarm(hurried, control):
    page, let_pass = hurried
    expect(page.locator("#ticks")).to_contain_text("0 overruns, 0 underruns meanwhile")
    control.overruns = 92
    expect(page.locator("#ticks.some")).to_contain_text("92 overruns, 0 underruns meanwhile")
    let_pass(11.0)
    expect(page.locator("#ticks:not(.some)")).to_contain_text("92 and 0 in")


def test_a_fault_is_shown_and_reset(page, served, control):
    arm_and_set(page)
    control.fail("the rig tripped: the monitor reads 1 V")
    text(page, "#state", "FAULT")
    text(
        page,
        "#alarm",
        "Fault: the rig tripped: the monitor reads 1 V. Remove the cause, then reset.",
    )
    expect(page.locator("#events li").first).to_contain_text("the rig tripped")
    page.click("#reset")
    await_state(served, "idle")
    expect(page.locator("#alarm")).to_be_hidden()


def test_a_lost_connection_does_not_look_alive_and_comes_back(page, served):
    arm_and_set(page)
    served.stop()
    try:
        text(page, "#link", "connection lost")
        text(page, "#state", "UNKNOWN")
        text(page, "#output", "UNKNOWN")
        expect(page.locator("#alarm")).to_contain_text("the output may be on")
        page.click("#off")
        expect(page.locator("#refusal-message")).to_contain_text("does not answer")
    finally:
        served.start()
    page.goto(served.url)  # the new daemon has another token
    text(page, "#link", "connected")


def test_the_other_pages_of_a_browser_cannot_use_the_api(browser, served):
    context = browser.new_context()
    page = context.new_page()
    page.goto("about:blank")
    origin = served.url.partition("/page/")[0]
    with pytest.raises(BrowserError, match="Failed to fetch"):
        page.evaluate(
            f"fetch('{origin}/off', {{method: 'POST', headers: {{Authorization: 'Bearer"
            f" {served.token}'}}}})"
        )
    context.close()


def test_it_shows_a_row_an_instrument_and_in_red_what_is_wrong(page, control):
    heard = Health("force_sensor", asked=200, missed=3, heard_s=99.5, took_s=2e-3)
    lost = heard._replace(name="finger_tracker", failed="the screen is gone")
    expect(page.locator("#instruments")).to_be_hidden()
    reporting = {"every_s": 0.02, "jitter_s": 0.0015}
    control.instruments = [
        InstrumentStatus.of(heard, 100.0),
        InstrumentStatus.of(lost, 100.0).model_copy(update=reporting),
    ]
    rows = page.locator("#instruments tr")
    expect(rows).to_have_text(
        [
            "force sensor500 ms2 ms3",
            "finger tracker500 ms2 ms3",
            "reports every 20 ms ± 1.5 ms",
            "the screen is gone",
        ]
    )
    expect(page.locator("#instruments td[title='of 200 questions']")).to_have_count(2)
    expect(page.locator("#instruments .some")).to_have_count(1)


def test_it_shows_agreement_mends_at_a_click_and_says_why(page, control):
    text(page, "#disagreement", "Not known yet: a minute of sliding tells.")
    cell = AgreementCell(axis="voltage_v", low=75.0, high=100.0, share=-0.08, weight=2e4)
    control.agreement, control.disagreement = (
        [cell],
        "8 % less friction than expected at 75..100 V, since 14:03",
    )
    text(page, "#disagreement", control.disagreement)
    expect(page.locator("#agreement i")).to_have_attribute("title", "-8.0 % at 75 to 100 V")
    page.click("#adapt")
    text(page, "#adaptation", "no refit yet")
    page.click("#adapt")
    expect(page.locator("#adaptation")).to_be_hidden()
    page.click("#why")
    expect(page.locator("#answer-said")).to_contain_text("Skin hydration is missing")
    page.click("#answer-show")
    expect(page.frame_locator("#report-page").locator("h1")).to_have_text("Why")
    page.click("#report-close")
    page.click("#answer-use")
    until(lambda: ("use_model", "other") in control.calls)
    assert page.complaints == []


def test_silence_is_a_lost_connection_and_what_was_chosen_is_so_still_when_it_comes_back(
    page, control
):
    """Names are fetched again then: the choice fell back, and Use took the model in use for the one
    that was meant.
    """
    page.select_option("#model", "other")
    page.evaluate("document.querySelector('#model').options[0].dataset.before = ''")
    control.lock.acquire()  # the API goes on, but has nothing to say
    try:
        text(page, "#link", "connection lost")
        text(page, "#state", "UNKNOWN")
    finally:
        control.lock.release()
    text(page, "#link", "connected")
    expect(page.locator("#model option[data-before]")).to_have_count(0)
    expect(page.locator("#model")).to_have_value("other")


def test_what_a_load_stage_does_is_one_line_where_there_is_one(page, control):
    expect(page.locator("#load")).to_be_hidden()
    control.load = LoadStatus(phase=LoadPhase.HOLD, target_n=0.5, load_n=0.4871, depth_m=0.012)
    expect(page.locator("#load")).to_have_text("Load stage: hold 0.5 N, 0.49 N measured")
    control.load = LoadStatus(phase=LoadPhase.MAY_PRESS, target_n=None, load_n=None, depth_m=None)
    expect(page.locator("#load")).to_have_text("Load stage: may press, – measured")
