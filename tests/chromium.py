"""Pages opened in a headless Chromium, with all that they say and ask for."""

import inspect
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
# Beside playwright's own, which keep the browser off the network.
FLAGS = ("--disable-gpu", "--disable-quic", "--disable-sync")
PHONE, DESKTOP = 390, 1280  #: Widths that a page is read at [pixel].
NARROW = 600  #: Below it a page is opened as on a phone: drawn 980 wide unless it asks for less [pixel].
OWN = ("file:", "data:", "blob:")  #: What a page asks for without a network.
BEYOND = """width => {
    const wide = Math.max(document.documentElement.scrollWidth, document.body.scrollWidth);
    if (wide <= width) return [];
    const end = e => Math.round(e.getBoundingClientRect().right);
    const beyond = [...document.body.querySelectorAll('*')].filter(e => end(e) > width);
    return [`the page is ${wide} wide on a screen of ${width}`].concat(beyond.map(e =>
        `to ${end(e)}: ${e.cloneNode(false).outerHTML.slice(0, 100)} ${e.textContent.trim().slice(0, 40)}`));
}"""
IDLE = "() => new Promise(done => requestAnimationFrame(() => setTimeout(() => done(performance.now()))))"


@dataclass
class Opened:
    """A page in a browser, and what it did since it was opened."""

    page: "Page"
    console: list[str] = field(default_factory=list)  #: Messages, each after its kind: `error: ...`.
    requests: list[str] = field(default_factory=list)  #: Addresses that were asked for.
    interactive: float = 0.0  #: From the start until it draws and answers [s].

    def faults(self) -> list[str]:
        """Complaints, what was asked of a network, and what is wider than the screen."""
        self.page.evaluate(IDLE)
        return [
            *(line for line in self.console if line.startswith(("error", "warning"))),
            *(f"asks for {address}" for address in self.requests if not address.startswith(OWN)),
            *self.page.evaluate(BEYOND, self.page.viewport_size["width"]),
        ]


THREAD = ThreadPoolExecutor(1, "browser")
"""Where pages are opened: playwright's event loop would be in the way of other tests in the main thread."""


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that opens pages in the browser's thread."""
    if "open_page" not in pyfuncitem.fixturenames:
        return None
    own = inspect.signature(pyfuncitem.obj).parameters
    THREAD.submit(pyfuncitem.obj, **{name: pyfuncitem.funcargs[name] for name in own}).result()
    return True


@pytest.fixture(scope="session")
def browser() -> Iterator["Browser"]:
    """One Chromium for all tests; nothing but its own thread may touch it."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip("no Chromium to open pages in: install the Debian package chromium")
    from playwright.sync_api import sync_playwright  # half a second

    play = THREAD.submit(sync_playwright().start).result()
    launch = partial(play.chromium.launch, executable_path=program, chromium_sandbox=False, args=FLAGS)
    running = THREAD.submit(launch).result()
    yield running
    THREAD.submit(running.close).result()
    THREAD.submit(play.stop).result()


@pytest.fixture
def open_page(browser: "Browser") -> Iterator[Callable[..., Opened]]:
    """Opens a file as `open_page(path, width, height, dark, scripts)`; each page has its own profile."""
    contexts = []

    def opened(
        path: Path, width: int = DESKTOP, height: int = 720, *, dark: bool = False, scripts: bool = True
    ) -> Opened:
        contexts.append(
            browser.new_context(
                viewport={"width": width, "height": height},
                color_scheme="dark" if dark else "light",
                is_mobile=width < NARROW,
                has_touch=width < NARROW,
                java_script_enabled=scripts,
            )
        )
        shown = Opened(contexts[-1].new_page())
        shown.page.on("console", lambda said: shown.console.append(f"{said.type}: {said.text}"))
        shown.page.on("pageerror", lambda error: shown.console.append(f"error: {error}"))
        shown.page.on("request", lambda request: shown.requests.append(request.url))
        shown.page.goto(path.resolve().as_uri())
        if scripts:
            shown.interactive = 1e-3 * shown.page.evaluate(IDLE)
        return shown

    yield opened
    for context in contexts:
        THREAD.submit(context.close).result()
