"""One browser for all tests of the page."""

import pytest


@pytest.fixture(scope="package")
def browser():
    from playwright.sync_api import sync_playwright

    from tests.haptic_driver.daemon.web.served_page import CHROMIUM

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()
