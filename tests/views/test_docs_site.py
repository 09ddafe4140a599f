"""The documentation site: pictures on every page to learn and do, no barriers, on phone and desk."""

import re
from pathlib import Path

import pytest
from chromium import PHONE

DOCS = Path(__file__).resolve().parents[2] / "docs"
TOCTREE = re.compile(r"```\{toctree\}\n:caption: (\w+)\n:hidden:\n\n(.*?)```", re.DOTALL)
PARTS = {caption: pages.split() for caption, pages in TOCTREE.findall((DOCS / "index.md").read_text())}
WIDE = 1440  #: Of a large screen [pixel].
LOOKED_AT = (
    "index",
    "start",
    "identify",
    "formats",
    "leaderboard",
    "mathematics/estimation",
    "studies/gravity_calibration",
    "tutorials/paper",
    "api",
    "cli",
    "search",
)
DARK = ("index", "leaderboard", "mathematics/estimation", "tutorials/paper", "api")
"""Looked at in the dark too: cards, a table, formulas, code with its outputs, signatures."""
THEME = "theme => { document.body.dataset.theme = theme }"


def test_every_page_to_learn_and_to_do_has_a_picture():
    for name in PARTS["Learn"] + PARTS["Do"]:
        text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        assert re.search(r"!\[[^]]{10,}\]\(|^    alt: .{10,}$", text, re.MULTILINE), name


@pytest.mark.parametrize("name", [name for name in PARTS["Learn"] if name.startswith("tutorials/")])
def test_a_tutorial_ends_with_what_to_do_next_and_is_stored_without_outputs(name):
    text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    assert text.startswith("---\nfile_format: mystnb\n")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE)[-1] == "What to do next"
    assert "data:image" not in text


@pytest.fixture(scope="session")
def site():
    """The site that `make docs` has built before it runs these tests."""
    built = DOCS / "_build" / "html"
    if not (built / "index.html").is_file():
        pytest.skip("make docs builds the site and looks at it")
    return built


@pytest.mark.look
@pytest.mark.parametrize("name", LOOKED_AT)
def test_a_page_has_no_barrier_and_is_as_wide_as_its_screen(open_page, site, name):
    """axe finds nothing, nothing is asked of a network, and no text is beyond the edge."""
    sync_playwright = pytest.importorskip("axe_playwright_python.sync_playwright")
    shown = open_page(site / f"{name}.html", WIDE)
    for theme in ("light", "dark")[: 1 + (name in DARK)]:
        shown.page.emulate_media(color_scheme=theme)
        shown.page.evaluate(THEME, theme)
        found = sync_playwright.Axe().run(shown.page, options={"preload": False}).response["violations"]
        said = [(own["id"], own["nodes"][0]["html"], own["nodes"][0]["failureSummary"]) for own in found]
        assert said == [], theme
    for width in (PHONE, WIDE):
        shown.page.set_viewport_size({"width": width, "height": 844})
        assert shown.faults() == []


@pytest.mark.look
def test_the_search_of_the_site_finds_a_page(open_page, site):
    shown = open_page(site / "search.html")
    shown.page.goto(f"{(site / 'search.html').as_uri()}?q=compensator")
    found = shown.page.locator("#search-results", has_text="Identify a stiffness model")
    found.wait_for(timeout=60_000)  # results appear one by one
