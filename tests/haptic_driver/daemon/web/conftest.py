"""One browser for all tests of the page, and what it looks at."""

import pytest


@pytest.fixture(scope="package")
def browser():
    from playwright.sync_api import sync_playwright

    from tests.haptic_driver.daemon.web.served_page import CHROMIUM

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def one_control():
    from tests.haptic_driver.daemon.web.served_page import SlidingControl

    return SlidingControl()


@pytest.fixture(scope="module")
def served(one_control, tmp_path_factory):
    from tests.haptic_driver.daemon.web.served_page import Served

    served = Served(one_control, tmp_path_factory.mktemp("served"))
    yield served
    served.stop()


@pytest.fixture
def control(one_control):
    """One for all, idle and as it was."""
    one_control.begin_anew()
    return one_control


@pytest.fixture(scope="module")
def one_tab(browser):
    from tests.haptic_driver.daemon.web.served_page import tab

    page = tab(browser)
    yield page
    page.context.close()


@pytest.fixture
def page(one_tab, served, control):
    """Loaded anew, from a daemon that knows nothing of the page before."""
    from tests.haptic_driver.daemon.web.served_page import leave_quietly, load

    load(one_tab, served)
    yield one_tab
    one_tab.unroute_all()
    leave_quietly(one_tab)
