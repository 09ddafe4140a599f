"""Pages in a headless Chromium."""

import json

import pytest
from chromium import DESKTOP, PHONE

from testbench.views.page.html import FOLDER, SCRIPTS

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


RAMP = [[0, 0, 255], [0, 255, 0], [255, 0, 0]]
LINES = [
    {"name": "A", "colour": "#008800", "values": [1.0, 3.0, 2.0], "ends": [[0.5, 2.5, 1.5], [1.5, 3.5, 2.5]]},
    {"name": "B", "colour": "#c28400", "values": [0.1, 0.2, 0.3], "ends": None},
]
PIXEL = """(k) => {
  const own = map.panes[0], [x, y] = [own.places[3 * k], own.places[3 * k + 1]];
  const rgba = own.canvas.getContext("2d").getImageData(x, y, 1, 1).data;
  return rgba[0] - rgba[2];
}"""


def scripted(body):
    """A page with the scripts of every report's page and nothing else."""
    script = "\n".join((FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS if name != "page.js")
    head = f'<!doctype html><meta charset="utf-8">{FITS}<body><div id="place"></div>'
    return f'{head}<script>{script}\nconst place = document.getElementById("place");\n{body}</script>'


@pytest.mark.look
def test_colours_of_a_map_run_from_the_least_error_to_the_greatest(open_page, write):
    data = {"at": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "lines": LINES, "group": 0}
    asked = f"window.map = new Maps(place, {json.dumps(data)}, {json.dumps(RAMP)}, () => 0)"
    page = open_page(write(scripted(asked))).page
    seen = page.evaluate("[0.1, 3].map((mm) => map.colour(map.share(mm)))")
    assert seen == ["rgb(0,0,255)", "rgb(255,0,0)"]
    page.wait_for_function("map.panes.every((pane) => pane.places)")
    assert page.evaluate(f"({PIXEL})(1)") > page.evaluate(f"({PIXEL})(0)")  # the greatest is the reddest
    key = page.inner_text(".key")
    assert key.startswith("0.1 mm")
    gradient = page.evaluate("document.querySelector('.ramp').style.background")
    assert gradient.index("0, 0, 255") < gradient.index("255, 0, 0")


@pytest.mark.look
def test_a_chart_of_runs_sorts_the_worst_first_and_says_numbers_with_their_intervals(open_page, write):
    chart = {"title": "t", "labels": ["1", "2", "3"], "lines": LINES, "limit": None, "group": 0, "note": ""}
    asked = f'runChart(place, {json.dumps(chart)}, ["run 1", "run 2", "run 3"], () => 0)'
    page = open_page(write(scripted(asked))).page
    box = page.locator("svg[role=img]").bounding_box()

    def first():
        page.mouse.move(box["x"] + 70, box["y"] + 100)
        return page.inner_text(".tip")

    assert first() == "run 1: A 1.000 (0.500 to 1.500), B 0.100"
    page.get_by_role("button", name="worst first").click()
    assert first() == "run 2: A 3.000 (2.500 to 3.500), B 0.200"


@pytest.mark.look
def test_a_column_is_drawn_with_its_own_numbers(open_page, write):
    cells = [
        [{"text": n}, {"text": f"{v} mm", "v": v}, {"text": "9", "v": 9.0}]
        for n, v in (("A", 1.5), ("B", 4.0))
    ]
    table = {"rows": [{"cells": own, "marked": False} for own in cells], "looks": {}}
    table["head"] = [{"title": title} for title in ("model", "error", "other")]
    page = open_page(write(scripted(f"place.append(drawColumn({json.dumps(table)}, 1, 600))"))).page
    told = page.evaluate(
        "[...document.querySelectorAll('svg > text')].map((own) => own.firstChild.textContent)"
    )
    assert [text for text in told if text in ("1.5", "4.0", "4", "9")][-2:] == ["1.5", "4.0"]
    across = page.evaluate("[...document.querySelectorAll('svg title')].map((own) => own.textContent)")
    assert {"A: 1.5 mm", "B: 4.0 mm"} <= set(across)
