"""The console in a real Chromium: robots drive, the slider shows the past, a story opens."""

import shutil
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn
from fastapi import FastAPI
from playwright.sync_api import ConsoleMessage, Page, expect, sync_playwright
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from replay.api import router
from tests.replay.site import (
    CHAIN_FORMS_MS,
    CHAIN_GROWS_MS,
    CHAIN_MS,
    SCENE,
    START_MS,
    TURN_MS,
    WAITING,
    Site,
    carried,
)

pytestmark = pytest.mark.browser

ARTEFACTS = Path(__file__).parents[2] / "artefacts"
ARGUMENTS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
PAST_S = 150


class Locked:
    """Lets nobody ask for data without the key, as a server does that has keys."""

    def __init__(self, app: ASGIApp, key: str) -> None:
        self._app = app
        self._key = key.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = dict(scope.get("headers", ()))
        if scope["path"].startswith("/api/") and headers.get(b"xyy-app-key") != self._key:
            await JSONResponse({"code": "errNotSignedIn"}, 401)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


class Running:
    """A site whose time goes on with the wall, served on a free port of this machine."""

    def __init__(self, data: Path, key: str | None = None) -> None:
        self.site = Site(data)
        self.site.run(PAST_S if key is None else 5)
        app = FastAPI()
        app.include_router(router(self.site.source))
        if key is not None:
            app.add_middleware(Locked, key=key)
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="warning", ws="none"))
        self._stopped = threading.Event()
        self._threads = [
            threading.Thread(target=self._server.run, kwargs={"sockets": [self._socket]}),
            threading.Thread(target=self._live),
        ]
        for thread in self._threads:
            thread.start()

    def _live(self) -> None:
        while not self._stopped.wait(0.1):  # the wall's pace: the page polls in real time
            self.site.run(0.1)

    def close(self) -> None:
        self._stopped.set()
        self._server.should_exit = True
        for thread in self._threads:
            thread.join()
        self._socket.close()
        self.site.close()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = Running(tmp_path_factory.mktemp("site"))
    yield running
    running.close()


@pytest.fixture(scope="module")
def page(running: Running) -> Iterator[Page]:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(20_000)
        yield page
        browser.close()


@pytest.fixture
def console(page: Page, running: Running) -> Iterator[Page]:
    """The page, freshly loaded; at the end nobody may have complained."""
    said: list[str] = []

    def heard(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            said.append(message.text)

    def crashed(error: Exception) -> None:
        said.append(str(error))

    page.on("console", heard)
    page.on("pageerror", crashed)
    page.goto(running.url)
    expect(page.locator("body")).to_have_attribute("data-state", "ready")
    yield page
    page.goto("about:blank")  # a new page for each test; a request on its way may be cut off
    page.remove_listener("console", heard)
    page.remove_listener("pageerror", crashed)
    assert said == []


@pytest.fixture
def locked(tmp_path: Path) -> Iterator[Running]:
    running = Running(tmp_path, key="right")
    yield running
    running.close()


def picture(page: Page, name: str) -> None:
    ARTEFACTS.mkdir(exist_ok=True)
    page.screenshot(path=ARTEFACTS / name)


def place_of(page: Page, robot: str) -> float:
    """Where along the bottom lane the page draws a robot just now."""
    return float(
        page.evaluate(
            """name => {
                const robots = window.fleetledger.stage.robots;
                return robots.pose(robots.shown.get(name), performance.now()).x;
            }""",
            robot,
        )
    )


def test_robots_are_drawn_and_move(console: Page) -> None:
    expect(console.locator("#tally")).to_contain_text("charging")
    before = place_of(console, "R1")
    console.wait_for_function(
        """before => {
            const robots = window.fleetledger.stage.robots;
            const pose = robots.pose(robots.shown.get("R1"), performance.now());
            return Math.abs(pose.x - before) > 0.5;
        }""",
        arg=before,
    )
    painted = console.evaluate(
        """() => {
            const { view, robots } = window.fleetledger.stage;
            const pose = robots.shown.get("R2").to;
            const [x, y] = view.toScreen(pose.x, pose.y).map(v => v * devicePixelRatio);
            const pen = document.querySelector("#map").getContext("2d");
            return [...pen.getImageData(x - 2, y - 2, 1, 1).data].slice(0, 3);
        }"""
    )
    assert painted == [0x15, 0x80, 0x3D]  # green: it charges
    picture(console, "console-live.png")


def test_the_slider_shows_an_older_state(console: Page) -> None:
    expect(console.locator("body")).to_have_attribute("data-mode", "live")
    then_ms = START_MS + 4_000 + TURN_MS + 7_000  # R1 is 7 m along, with the second load
    console.locator("#slider").evaluate(
        """(slider, ms) => {
            slider.value = ms;
            slider.dispatchEvent(new Event("input", {bubbles: true}));
            slider.dispatchEvent(new Event("change", {bubbles: true}));
        }""",
        str(then_ms),
    )
    expect(console.locator("body")).to_have_attribute("data-mode", "past")
    console.wait_for_function("() => window.fleetledger.frame.live === false")
    first = console.locator("#orders li").first
    expect(first).to_have_attribute("data-order", carried(1))
    expect(first).to_contain_text("under way")
    console.wait_for_function(
        """() => {
            const robots = window.fleetledger.stage.robots;
            return Math.abs(robots.pose(robots.shown.get("R1"), performance.now()).x - 7) < 0.3;
        }"""
    )
    picture(console, "console-past.png")
    console.locator("#live").click()
    expect(console.locator("body")).to_have_attribute("data-mode", "live")
    console.wait_for_function("() => window.fleetledger.frame.live === true")


def test_a_past_stretch_plays_and_pauses(console: Page) -> None:
    console.evaluate("ms => window.fleetledger.moment.go(ms)", START_MS + 10_000)
    console.locator('[data-speed="10"]').click()
    console.get_by_role("button", name="Play").click()
    console.wait_for_function("ms => window.fleetledger.frame.atMs > ms", arg=START_MS + 20_000)
    console.get_by_role("button", name="Pause").click()
    expect(console.locator("#mode")).to_have_text("Past moment")


def test_an_orders_whole_story_opens_on_a_click(console: Page) -> None:
    console.locator(f'[data-order="{WAITING}"] button').click()
    expect(console.locator("#detail-title")).to_have_text(WAITING)
    expect(console.locator(".events li")).to_have_count(2)
    expect(console.locator(".callout")).to_contain_text("R3: offline")
    console.locator("#back").click()
    console.evaluate("ms => window.fleetledger.moment.go(ms)", START_MS + TURN_MS + 12_000)
    console.locator(f'[data-order="{carried(1)}"] button').click()
    expect(console.locator(".events")).to_contain_text("assigned to R1")
    expect(console.locator(".steps li.Done")).to_have_count(1)
    console.wait_for_function("() => window.fleetledger.stage.selected === 'R1'")
    picture(console, "console-story.png")
    console.locator("#detail").get_by_role("button", name="R1", exact=True).click()
    expect(console.locator("#detail-title")).to_have_text("R1")
    expect(console.locator("#detail-body")).to_contain_text("Battery")


def test_a_click_on_a_robot_shows_what_is_known_of_it(console: Page) -> None:
    left, top = console.evaluate(
        """() => {
            const { view, robots } = window.fleetledger.stage;
            const pose = robots.shown.get("R2").to;
            return view.toScreen(pose.x, pose.y);
        }"""
    )
    console.locator("#map").click(position={"x": left, "y": top})
    expect(console.locator("#detail-title")).to_have_text("R2")
    expect(console.locator("#detail-body")).to_contain_text("31 %")
    console.keyboard.press("Escape")
    expect(console.locator("#list")).to_be_visible()


def test_a_wait_chain_is_shown_as_it_forms_and_dissolves(console: Page) -> None:
    chains = console.locator("#chains li")
    begun_ms = START_MS + 80_000
    console.evaluate("ms => window.fleetledger.moment.go(ms)", begun_ms + CHAIN_FORMS_MS - 700)
    console.wait_for_function("() => window.fleetledger.frame.live === false")
    expect(console.locator("#waits")).to_be_hidden()
    assert console.evaluate("() => window.fleetledger.stage.waits.arrows") == 0
    console.evaluate("ms => window.fleetledger.moment.go(ms)", begun_ms + CHAIN_FORMS_MS + 1_300)
    expect(chains).to_have_attribute("data-chain", "R2")
    expect(chains).to_have_attribute("data-root", "R1")
    expect(chains).to_contain_text("waits for R1 to drive on")
    console.wait_for_function("() => window.fleetledger.stage.waits.arrows === 1")
    console.evaluate("ms => window.fleetledger.moment.go(ms)", begun_ms + CHAIN_GROWS_MS + 3_400)
    expect(chains).to_have_attribute("data-chain", "R2 R1")
    expect(chains).to_contain_text("waits for ground reserved for 'lift maintenance'")
    expect(chains.locator(".since").first).to_have_text("5 s")
    expect(chains.locator(".since").last).to_have_text("3 s")
    picture(console, "console-waits.png")
    console.evaluate("ms => window.fleetledger.moment.go(ms)", begun_ms + CHAIN_MS + 900)
    expect(console.locator("#waits")).to_be_hidden()
    console.locator("#live").click()  # and live, within one round of the script
    expect(chains).to_have_attribute("data-chain", "R2", timeout=2 * CHAIN_MS)
    expect(chains).to_have_attribute("data-chain", "R2 R1")
    expect(console.locator("#waits")).to_be_hidden()
    console.wait_for_function("() => window.fleetledger.stage.waits.arrows === 0")


def test_robots_that_wait_for_each_other_are_two_red_arrows(console: Page) -> None:
    console.evaluate(
        """() => {
            const { stage } = window.fleetledger;
            const wait = (robot, other) => ({ robot, blockers: [other] });
            const chain = { robots: ["R1", "R2"], root: "R1", closed: true };
            const take = stage.waits.take.bind(stage.waits);
            stage.waits.take = () => take([wait("R1", "R2"), wait("R2", "R1")], [chain]);
        }"""
    )
    console.wait_for_function("() => window.fleetledger.stage.waits.arrows === 2")
    assert console.evaluate("() => [...window.fleetledger.stage.waits.closed]") == ["R1", "R2"]


def test_the_filter_finds_orders_by_their_reasons(console: Page) -> None:
    console.locator("#find").fill("offline")
    expect(console.locator("#orders li")).to_have_count(1)
    expect(console.locator("#orders li")).to_have_attribute("data-order", WAITING)
    console.locator("#find").fill("no such thing")
    expect(console.locator("#no-orders")).to_be_visible()


def test_where_keys_are_on_the_page_asks_for_a_pair_once(page: Page, locked: Running) -> None:
    page.goto(locked.url)
    page.get_by_role("button", name="Use a key pair instead").click()
    for key in ("wrong", "right"):
        page.locator("#app-id").fill("console")
        page.locator("#app-key").fill(key)
        page.get_by_role("button", name="Sign in").click()
        if key == "wrong":
            expect(page.locator("#keys-wrong")).to_be_visible()
    expect(page.locator("body")).to_have_attribute("data-state", "ready")
    page.reload()
    expect(page.locator("body")).to_have_attribute("data-state", "ready")
    expect(page.locator("#keys")).to_be_hidden()
    page.goto("about:blank")


def test_on_a_wide_screen_nothing_is_cut_off(console: Page) -> None:
    console.set_viewport_size({"width": 1920, "height": 1080})
    expect(console.locator("#live")).to_be_in_viewport(ratio=1)
    expect(console.locator("#mode")).to_be_in_viewport(ratio=1)
    console.set_viewport_size({"width": 1280, "height": 800})
    expect(console.locator("#live")).to_be_in_viewport(ratio=1)
    assert console.evaluate("() => window.fleetledger.frame.scene") == SCENE
