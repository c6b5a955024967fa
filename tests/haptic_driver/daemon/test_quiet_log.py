"""One kind of trouble does not fill the log."""

import logging

from haptic_driver.daemon.quiet_log import OncePerSecond
from tests.clock import ManualClock


def test_a_flood_is_a_line_a_second_that_says_how_much_was_left_out_and_hides_no_other():
    clock, log, said = ManualClock(), logging.getLogger("flooded"), list[str]()
    handler = logging.Handler()  # its own: others' may have filters of other tests
    handler.emit = lambda record: said.append(record.getMessage())
    handler.addFilter(OncePerSecond(clock))
    log.addHandler(handler)
    try:
        for number in range(1000):
            log.error("no descriptor for %d", number)
            clock.sleep(0.01)
        log.error("%s", "something else")
        log.error("%s", "another thing")
    finally:
        log.removeHandler(handler)
    assert said[0] == "no descriptor for 0"
    assert len(said) == 12
    assert said[1].endswith("(99 more like this were left out)")
    assert said[-2:] == ["something else", "another thing"]
