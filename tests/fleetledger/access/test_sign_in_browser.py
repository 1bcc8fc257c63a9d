"""Signing in at the console of a real server, in a real Chromium."""

import shutil
from pathlib import Path

import pytest
from playwright.sync_api import expect, sync_playwright

from tests.fleetledger.access.test_access_server import PASSWORD, fleetledger
from tests.fleetledger.server import serving, small_scene
from tests.replay.test_console_browser import ARGUMENTS

pytestmark = pytest.mark.browser


def test_a_person_signs_in_looks_reloads_and_signs_out(tmp_path: Path) -> None:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    data = tmp_path / "data"
    data.mkdir()
    fleetledger("user", "add", str(data), "anna", told=PASSWORD)
    with (
        serving(data, "--scene", str(small_scene(tmp_path))) as server,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(30_000)
        page.goto(server.url)
        for password in ("wrong password", PASSWORD):
            page.locator("#app-id").fill("anna")
            page.locator("#app-key").fill(password)
            page.get_by_role("button", name="Sign in").click()
            if password != PASSWORD:
                expect(page.locator("#keys-wrong")).to_have_text("User name or password is wrong.")
        expect(page.locator("body")).to_have_attribute("data-state", "ready")
        page.reload()
        expect(page.locator("body")).to_have_attribute("data-state", "ready")
        assert "xzz-qyx" not in page.evaluate("document.cookie")
        page.get_by_role("button", name="Sign out anna").click()
        expect(page.locator("#keys")).to_be_visible()
        browser.close()
