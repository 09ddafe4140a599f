"""Pages in a headless Chromium."""

import pytest
from chromium import DESKTOP, PHONE

FITS = '<meta name="viewport" content="width=device-width">'
PAGE = f"""<!doctype html><meta charset="utf-8">{FITS}<title>A page</title>
<style>@media (prefers-color-scheme: dark) {{ p {{ color: rgb(1, 2, 3) }} }}</style>
<p id="said">0</p><button onclick="said.textContent = 1 + +said.textContent">more</button>"""
BROKEN = """<script>console.error("bad"); setTimeout(() => { throw new Error("late") })</script>
<img src="http://localhost:9/x.png"><div style="width: 1400px" id="plank">w</div>"""


@pytest.fixture
def write(tmp_path):
    def written(text):
        path = tmp_path / "page.html"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def test_a_sound_page_is_drawn_and_clicked_in_the_light_and_in_the_dark(open_page, write):
    light, dark = (open_page(write(PAGE), dark=dark) for dark in (False, True))
    light.page.get_by_role("button", name="more").click()
    assert light.page.inner_text("#said") == "1"
    colours = [shown.page.evaluate("getComputedStyle(said).color") for shown in (light, dark)]
    assert colours == ["rgb(0, 0, 0)", "rgb(1, 2, 3)"]
    assert light.page.screenshot() != dark.page.screenshot()
    assert light.interactive > 0
    assert [*light.faults(), *dark.faults()] == []


@pytest.mark.parametrize("width", [PHONE, DESKTOP])
def test_faults_of_a_page_are_seen(open_page, write, width):
    faults = "\n".join(open_page(write(PAGE + BROKEN), width).faults())
    for fault in ("error: bad", "error: late", "asks for http://localhost:9/x.png", "plank"):
        assert fault in faults


def test_a_page_that_does_not_fit_itself_to_a_phone_is_seen(open_page, write):
    assert open_page(write(PAGE), PHONE).faults() == []
    unfit = open_page(write(PAGE.replace(FITS, "")), PHONE)
    assert unfit.faults()[0] == "the page is 980 wide on a screen of 390"
