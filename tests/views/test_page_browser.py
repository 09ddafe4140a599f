"""Pages in a headless Chromium."""

import json
from dataclasses import replace

import numpy as np
import pytest
from chromium import DESKTOP, PHONE
from made_up_run import REPORT, made_up_run
from matplotlib.image import imsave
from scipy.spatial.transform import Rotation

from testbench.plant.shapes import BodyFrames
from testbench.report.badge import decide
from testbench.report.page import FOLDER, SCRIPTS, write_page
from testbench.report.page import frames_plain as _frames
from testbench.report.schema import Table, TableColumn

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
    """A page that does not fit itself to a phone, too."""
    faults = "\n".join(open_page(write(PAGE + BROKEN), width).faults())
    for fault in ("error: bad", "error: late", "asks for http://localhost:9/x.png", "plank"):
        assert fault in faults
    assert bool(open_page(write(PAGE.replace(FITS, "")), width).faults()) == (width == PHONE)


RAMP = [[0, 0, 255], [0, 255, 0], [255, 0, 0]]
LINES = [
    {
        "name": "A",
        "words": "first model",
        "colour": "#008800",
        "values": [1.0, 3.0, 2.0],
        "ends": [[0.5, 2.5, 1.5], [1.5, 3.5, 2.5]],
    },
    {"name": "B", "words": "second model", "colour": "#c28400", "values": [0.1, 0.2, 0.3], "ends": None},
]
CHART = {"title": "t", "across": "run", "labels": ["1", "2", "3"], "lines": LINES, "note": ""}
TIPS = (
    "a: first model 1.000 (0.500 to 1.500), second model 0.100",
    "b: first model 3.000 (2.500 to 3.500), second model 0.200",
)
CHOOSE = "(group, pose) => (window.chosen = [group, pose])"
PIXEL = """(pane, k) => {
  const own = map.panes[pane], [x, y] = [own.places[3 * k], own.places[3 * k + 1]];
  const rgba = own.canvas.getContext("2d").getImageData(x, y, 1, 1).data;
  return rgba[0] - rgba[2];
}"""


def scripted(body):
    """A page with the scripts of every report's page and nothing else."""
    script = "\n".join((FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS if name != "page.js")
    head = f'<!doctype html><meta charset="utf-8">{FITS}<body><div id="place"></div>'
    return f'{head}<script>{script}\nconst place = document.getElementById("place");\n{body}</script>'


def mapped(open_page, write, **more):
    """A map of three places, and its page."""
    data = {"at": [[0.5, 0.2, 0.3], [1, 0, 0.2], [0, 1, 0.6]], "lines": LINES, "group": 0} | more
    asked = f"window.map = new Maps(place, {json.dumps(data)}, {json.dumps(RAMP)}, {CHOOSE})"
    return data, open_page(write(scripted(asked))).page


@pytest.mark.look
def test_colours_of_a_map_run_from_the_least_error_to_the_greatest(open_page, write):
    data, page = mapped(open_page, write)
    seen = page.evaluate("[0.1, 3].map((mm) => map.colour(map.share(mm)))")
    assert seen == ["rgb(0,0,255)", "rgb(255,0,0)"]
    page.wait_for_function("map.panes.every((pane) => pane.places)")
    for k, line in enumerate(LINES):
        reds = [page.evaluate(f"({PIXEL})({k}, {place})") for place in range(3)]
        assert np.argsort(reds).tolist() == np.argsort(line["values"]).tolist()
        worst = int(np.argmax(line["values"]))
        x, y, z = data["at"][worst]
        pane = page.locator(".pane").nth(k)
        words = pane.inner_text()
        assert f"worst: {line['values'][worst]:g} mm" in words
        assert f"at x {x:.2f}, y {y:.2f}, z {z:.2f} m" in words
        box = pane.locator("canvas").bounding_box()
        for place in range(3):
            left, up = page.evaluate(
                f"[0, 1].map((k) => map.panes[{k}].places[3 * {place} + k] / map.panes[{k}].ratio)"
            )
            page.mouse.click(box["x"] + left, box["y"] + up)
            assert page.evaluate("chosen") == [0, place]
        pane.locator("button").click()
        assert page.evaluate("chosen") == [0, worst]
    key = page.inner_text(".key")
    assert key.startswith("0.1 mm")
    gradient = page.evaluate("document.querySelector('.ramp').style.background")
    assert gradient.index("0, 0, 255") < gradient.index("255, 0, 0")


@pytest.mark.look
def test_the_difference_of_two_maps_has_the_colour_of_the_one_that_errs_less(open_page, write):
    _, page = mapped(open_page, write, difference=[1, 0])
    values = page.evaluate("map.panes.at(-1).line.values")
    looks = page.evaluate("[-1, 1].map((x) => map.panes.at(-1).look(x)[0])")
    assert values == pytest.approx(np.subtract(LINES[1]["values"], LINES[0]["values"]))
    assert looks == [LINES[1]["colour"], LINES[0]["colour"]]
    assert "second model errs less in 3 of 3 places" in page.locator(".pane").last.inner_text()


DRAWN = """(svg) => {
  const all = (kind) => [...svg.querySelectorAll(kind)], number = (own, key) => Number(own.getAttribute(key));
  const ends = (own) => ["x1", "x2", "y1", "y2"].map((key) => number(own, key));
  const shade = (own) => own.getAttribute("stroke");
  return {
    ticks: all("text.soft").map((own) => [own.textContent, number(own, "x"), number(own, "y") - 4]),
    texts: all("text:not(.soft)").map((own) => [own.firstChild.textContent, number(own, "y") - 4]),
    dots: all("circle").map((own) => [number(own, "cx"), number(own, "cy"), shade(own), own.textContent]),
    lines: all("line:not(.grid)").map((own) => [...ends(own), shade(own)]),
  };
}"""
NAMES, COLOURS = ("A", "B", "C"), ("#008800", "#c28400", "#3462e8")


def table_of(numbers, titles, **more):
    """A table of models as the script has it: of every cell value and interval."""
    rows = []
    for name, own in zip(NAMES, numbers, strict=True):
        cells = [{"text": f"{v:g} mm", "v": v, "low": low, "high": high} for v, low, high in own]
        rows.append({"cells": [{"text": name}, *cells], "marked": False})
    looks = {n: {"colour": c, "mark": "o", "filled": True} for n, c in zip(NAMES, COLOURS, strict=True)}
    head = [{"title": title, "drawn": True} for title in ("model", *titles)]
    words = {name: name for name in NAMES}
    return {"rows": rows, "looks": looks, "words": words, "head": head, "first": -1} | more


def axis_of(ticks, which):
    """A function from places to the numbers that the ticks of an axis say, [what, x, y] each."""
    values = np.array([float(tick[0]) for tick in ticks])
    places = np.array([tick[which] for tick in ticks])
    logarithmic = (values > 0).all()  # any other has a zero
    fit = np.polyfit(places, np.log(values) if logarithmic else values, 1)
    return lambda place: np.exp(np.polyval(fit, place)) if logarithmic else np.polyval(fit, place)


@pytest.mark.look
@pytest.mark.parametrize("largest", [5.0, 500.0])
def test_a_column_is_drawn_by_its_own_numbers_with_their_intervals_in_the_colours_of_its_rows(
    open_page, write, largest
):
    """Dots and ends of lines are read back by the ticks, of a logarithmic axis too."""
    own = [(1.5, 1.2, 1.8), (4.0, 3.9, 4.5), (largest, 0.8 * largest, 1.3 * largest)]
    numbers = [(cell, (9.0, 8.0, 10.0)) for cell in own]
    table = table_of(numbers, ("error", "other"), words={name: f"model {name}" for name in NAMES})
    body = f"place.append(drawColumn({json.dumps(table)}, 1, 600))"
    page = open_page(write(scripted(body))).page
    drawn = page.evaluate(f"({DRAWN})(place.firstChild)")
    said = axis_of(drawn["ticks"], 1)
    texts = [text for text, _ in drawn["texts"]]
    for k, (name, colour, (v, low, high)) in enumerate(zip(NAMES, COLOURS, own, strict=True)):
        x, y, shade, words = drawn["dots"][k]
        assert (shade, words) == (colour, f"{name}: {v:g} mm")
        assert said(x) == pytest.approx(v, rel=1e-6)
        x1, x2, y1, y2, shade = drawn["lines"][k]
        assert said(np.array([x1, x2])) == pytest.approx([low, high], rel=1e-6)
        assert (y1, y2, shade) == (y, y, colour)
        assert texts[2 * k : 2 * k + 2] == [f"model {name}", f"{v:g}"]
        assert [at for _, at in drawn["texts"][2 * k : 2 * k + 2]] == [y, y]


@pytest.mark.look
@pytest.mark.parametrize(("stepwise", "order"), [(False, "CBA"), (True, "ABC")])
def test_rows_of_a_column_are_sorted_the_winner_first_but_steps_keep_their_order(
    open_page, write, stepwise, order
):
    table = table_of([[(v, v, v)] for v in (5.0, 1.0, 3.0)], ["error"], stepwise=stepwise)
    table["rows"][2]["marked"] = True
    page = open_page(write(scripted(f"place.append(drawColumn({json.dumps(table)}, 1, 600))"))).page
    texts = [text for text, _ in page.evaluate(f"({DRAWN})(place.firstChild)")["texts"]]
    assert "".join(texts[::2]) == order


@pytest.mark.look
@pytest.mark.parametrize("few", [True, False])
def test_trials_are_dots_of_their_numbers_and_few_of_them_have_no_median(open_page, write, few):
    trials = [[1.2, 1.5, 1.9], [3.8, 4.0, 4.6], [5.0, 6.0, 9.0]]
    table = table_of([[(own[1], own[0], own[2])] for own in trials], ["error"])
    for row, own in zip(table["rows"], trials, strict=True):
        row["cells"][1] |= {"dots": own, "few": few}
        if few:
            del row["cells"][1]["low"], row["cells"][1]["high"]
    table["rows"][0]["marked"] = True
    page = open_page(write(scripted(f"place.append(drawColumn({json.dumps(table)}, 1, 600))"))).page
    drawn = page.evaluate(f"({DRAWN})(place.firstChild)")
    said, size = axis_of(drawn["ticks"], 1), 3 if few else 4
    for k, own in enumerate(trials):
        dots = drawn["dots"][size * k : size * (k + 1)]
        assert [said(x) for x, *_ in dots] == pytest.approx([*own, *([] if few else own[1:2])], rel=1e-6)
        if few:
            assert {shade for *_, shade, _ in dots} == {COLOURS[k]}
    fills = page.eval_on_selector_all("circle.trial", "all => all.map(own => own.getAttribute('fill'))")
    assert fills == ([] if few else [colour for colour in COLOURS for _ in range(3)])
    assert len(drawn["lines"]) == (0 if few else 3)
    sizes = page.eval_on_selector_all("circle:not(.trial)", "all => all.map(own => +own.getAttribute('r'))")
    assert sizes[0] > sizes[-1]  # the winner


@pytest.mark.look
def test_the_winner_is_drawn_last_and_widest_where_columns_are_side_by_side(open_page, write):
    numbers = [[(v, v, v) for v in row] for row in ((1.0, 2.0), (1.0, 2.0), (7.0, 8.0))]
    table = table_of(numbers, ("10 um", "20 um"), across="noise", title="")
    table["rows"][0]["marked"] = True
    page = open_page(write(scripted(f"dotChart(place, {json.dumps(table)})"))).page
    words = page.eval_on_selector_all("g.row text", "all => all.map(own => own.firstChild.textContent)")
    assert words == ["B", "C", "A"]
    widths = page.eval_on_selector_all(
        "g.row path", "all => all.map(own => +own.getAttribute('stroke-width'))"
    )
    assert widths[-1] > max(widths[:-1])


@pytest.mark.look
def test_headings_and_charts_of_runs_are_used_by_the_keyboard_alone(open_page, write):
    chart = CHART | {"limit": None, "group": 4}
    body = f"""place.innerHTML = "<table><thead><tr><th>n</th></tr></thead><tbody><tr><td>2</td></tr>"
      + "<tr><td>not fitted</td></tr><tr><td>1</td></tr></tbody></table>";
    sortable(place.firstChild); runChart(place, {json.dumps(chart)}, ["a", "b", "c"], {CHOOSE})"""
    page = open_page(write(scripted(body))).page
    cells = "[...document.querySelectorAll('td')].map((own) => own.textContent)"
    page.keyboard.press("Tab")
    for key, order in (("Enter", ["1", "2", "not fitted"]), (" ", ["not fitted", "2", "1"])):
        page.keyboard.press(key)
        assert page.evaluate(cells) == order
    page.locator("svg[role=img]").focus()
    for key, k in (("ArrowRight", 0), ("ArrowRight", 1), ("End", 2), ("ArrowLeft", 1)):
        page.keyboard.press(key)
        assert page.inner_text(".tip").startswith(f"{'abc'[k]}: ")
    page.keyboard.press("Enter")
    assert page.evaluate("chosen") == [4, 1]


@pytest.mark.look
def test_columns_side_by_side_have_their_titles_below_their_own_dots(open_page, write):
    """Steps of a number are joined to a line a row; another quantity in the table is none of them."""
    each = ((1.0, 2.0, 4.0, 99.0), (9.0, 3.0, 5.0, 99.0), (7.0, 8.0, 6.0, 99.0))
    numbers = [[(v, v, v) for v in row] for row in each]
    titles = ("10 um", "20 um", "30 um", "cost")
    table = table_of(numbers, titles, across="noise", title="")
    page = open_page(write(scripted(f"dotChart(place, {json.dumps(table)})"))).page
    drawn = page.evaluate(f"({DRAWN})(document.querySelector('svg[role=img]'))")
    below = {text: x for text, x, _ in drawn["ticks"] if text in titles}
    said = axis_of([tick for tick in drawn["ticks"] if tick[0] not in titles], 2)
    for k, (x, y, shade, words) in enumerate(drawn["dots"]):
        row, column = divmod(k, 3)
        assert (x, shade) == (below[titles[column]], COLOURS[row])
        assert said(y) == pytest.approx(numbers[row][column][0], rel=1e-6)
        assert words == f"{NAMES[row]}: {numbers[row][column][0]:g} mm"
    assert [text for text, _ in drawn["texts"]] == list(NAMES)
    assert (len(drawn["dots"]), page.locator("svg .row path[opacity]").count()) == (9, 3)
    assert "cost" not in below


@pytest.mark.look
def test_what_is_clicked_in_a_chart_of_runs_is_the_run_that_is_drawn_there(open_page, write):
    """Dots and intervals are read back by the ticks, in the order of runs and worst first."""
    chart = CHART | {"limit": 2.2, "group": 4}
    page = open_page(write(scripted(f'runChart(place, {json.dumps(chart)}, ["a", "b", "c"], {CHOOSE})'))).page
    svg = page.locator("svg[role=img]")
    box = svg.bounding_box()
    for order in ([0, 1, 2], [1, 2, 0]):
        drawn = svg.evaluate(DRAWN)
        ticks = [tick for tick in drawn["ticks"] if tick[1] < 44]
        said, labels = axis_of(ticks, 2), [tick[0] for tick in drawn["ticks"] if tick[1] > 44]
        assert labels == [*(chart["labels"][k] for k in order), "run"]
        dots, (level, *lines) = iter(drawn["dots"]), drawn["lines"]
        assert said(level[2]) == pytest.approx(2.2, rel=1e-6)
        page.mouse.move(box["x"] + 70, box["y"] + 100)
        assert page.inner_text(".tip").startswith(TIPS[order[0]])
        ends = [[line["ends"][0][k], line["ends"][1][k]] for k in order for line in LINES[:1]]
        np.testing.assert_allclose([said(np.array(one[2:4])) for one in lines], ends, rtol=1e-6)
        for k in order:
            for line in LINES:
                x, y, shade, _ = next(dots)
                assert said(y) == pytest.approx(line["values"][k], rel=1e-6)
                assert shade == line["colour"]
            page.mouse.click(box["x"] + x, box["y"] + 100)
            assert page.evaluate("chosen") == [4, k]
        page.get_by_role("button", name="worst first").click()


@pytest.mark.look
def test_bodies_stand_in_a_page_where_their_frames_have_them_and_points_where_an_eye_would_see_them(
    open_page, write, rng
):
    """Turns by matrices, and a pinhole before the eye with z up, in numpy; all points are in the picture."""
    turns, at = Rotation.random(2, rng=rng).as_matrix(), rng.normal(size=(2, 3))
    [numbers] = _frames(BodyFrames(at[None], turns[None]))
    body = rng.normal(size=(5, 3))
    page = open_page(write(scripted(""))).page
    for k in range(2):
        points = page.evaluate(f"Array.from(moved({body.ravel().tolist()}, {numbers}, {7 * k}))")
        np.testing.assert_allclose(np.reshape(points, (-1, 3)), body @ turns[k].T + at[k], atol=1e-3)
    (width, height), yaw, pitch, cloud = (640, 480), 0.7, 0.3, rng.normal(size=(40, 3))
    page.evaluate(f"window.camera = Camera.around({cloud.ravel().tolist()}, {yaw}, {pitch})")
    asked = f"camera.projector({width}, {height})(...p, out, 0)"
    seen = page.evaluate(f"{cloud.tolist()}.map((p) => {{ const out = [0, 0, 0]; {asked}; return out }})")
    target, distance = np.array(page.evaluate("camera.target")), page.evaluate("camera.distance")
    away = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.cross([0, 0, 1], away) / np.cos(pitch)
    up = np.cross(away, right)
    offset = cloud - target - distance * away
    depth = -offset @ away
    x, y = (offset @ axis / depth for axis in (right, up))
    focal = page.evaluate("FOCAL") * height / 2
    there = np.column_stack([width / 2 + focal * x, height / 2 - focal * y, depth])
    np.testing.assert_allclose(seen, there, rtol=1e-9)
    assert (there[:, :2] > 0).all()
    assert (there[:, :2] < (width, height)).all()


def layer(name, colour, kind, at, to=None, shown=True):
    whole = [None if x is None else (1e4 * np.array(x)).tolist() for x in (at, to)]
    own = dict(zip(("at", "to"), whole, strict=True))
    return {"name": name, "colour": colour, "kind": kind, "labels": [], "shown": shown} | own


SEEN = """([x, y, z, along, aside, dx, dy, dz]) => {
  const canvas = scene.canvas, out = [0, 0, 0, 0, 0, 0], pen = canvas.getContext("2d");
  const project = scene.camera.projector(canvas.width, canvas.height);
  project(x, y, z, out, 0);
  project(x + dx, y + dy, z + dz, out, 3);
  const [u, v] = [out[3] - out[0], out[4] - out[1]], size = Math.hypot(u, v) || 1;
  const at = [out[0] + (along * u - aside * v) / size, out[1] + (along * v + aside * u) / size];
  return [...pen.getImageData(Math.floor(at[0]), Math.floor(at[1]), 1, 1).data.slice(0, 3)];
}"""


@pytest.mark.look
def test_a_pose_shows_its_own_layers_and_words_and_those_that_are_ticked_alone(open_page, write):
    """Dots at their places, arrows with their heads where they end."""
    red, blue, green, still = [255, 0, 0], [0, 0, 255], [0, 255, 0], [[[0.0] * 6 + [1.0]]] * 2
    dots, other = [[0, 0, 0], [0, 1, 0.5]], [[0, 0.5, 1], [0, 0.5, 1]]
    start, end = [[0, 0, 2], [0, 0, 2]], [[0, 1, 2], [0, 1, 2]]
    layers = [
        layer("on", "#ff0000", "dots", dots),
        layer("off", "#0000ff", "dots", other, shown=False),
        layer("way", "#00ff00", "arrows", start, end),
    ]
    rigid = [(1e4 * np.array(pose)).ravel().tolist() for pose in still]
    group = {"name": "g", "names": ["a", "b"], "words": ["One", "Two"], "first": 1, "near": None}
    data = {"title": "T.", "solids": [], "groups": [group | {"rigid": rigid, "bent": None, "layers": layers}]}
    made = "place.innerHTML = \"<canvas style='width:400px;height:400px'></canvas>\""
    body = f"{made}; window.scene = new Scene(place, {json.dumps(data)})"
    page = open_page(write(scripted(body))).page

    def at(place, along=0, aside=0, way=(0, 1, 0)):
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
        return page.evaluate(SEEN, [*place, along, aside, *way])

    def shown():
        return [at(dots[0]) == red, at(dots[1]) == red, at(other[0]) == blue]

    assert page.locator(".says").first.inner_text() == "b. Two"
    assert shown() == [False, True, False]
    assert min(at(end[0], -8, aside)[1] for aside in (2.6, -2.6)) > 200  # its head is wider
    assert max(at(start[0], 8, aside)[1] for aside in (2.6, -2.6)) == 0
    assert at(start[0], 20) == green
    page.locator("input[type=range]").fill("0")
    assert page.locator(".says").first.inner_text() == "a. One"
    assert shown() == [True, False, False]
    for name in ("on", "off"):
        page.get_by_label(name, exact=True).click()
    assert shown() == [False, False, True]


@pytest.mark.look
def test_a_page_is_printed_on_one_sheet_with_badge_picture_table_settings_and_versions(
    open_page, arm_6r, tmp_path
):
    badge = decide(("one", [1.0] * 8), ("other", [2.0] * 8))
    seen = made_up_run(arm_6r)
    table = Table(
        (TableColumn("name", "model"), TableColumn("mm", "error", "mm")),
        [{"name": "one", "mm": 1.0}, {"name": "other", "mm": 2.0}],
        "Models",
    )
    write_page(tmp_path, "made up", replace(REPORT, badge=badge), replace(seen, tables=[table, table]))
    page = open_page(tmp_path / "report.html", dark=True).page
    sheet = {"width": 703, "height": 1032}  # A4 without margins of 12 mm, 96 to the inch
    page.set_viewport_size(sheet)
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate("document.documentElement.scrollHeight") <= sheet["height"]
    shown = page.evaluate("document.body.innerText")
    for words in (badge.words, REPORT.answer, "Models", REPORT.title, "mujoco"):
        assert words in shown
    assert page.locator("#scene canvas").bounding_box()["height"] > 150
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.locator("table:visible").count() == 1
    assert page.locator("#map, .runs, input, .screen, button").locator("visible=true").count() == 0
    scene = seen.scene
    for words in (scene.title, *(layer.name for layer in scene.groups[0].layers)):  # caption and legend
        assert words in shown
    assert page.locator(".chart svg").first.bounding_box()["height"] > 40


@pytest.mark.look
def test_where_scripts_are_off_pictures_stand_in_place_of_what_they_would_draw(open_page, arm_6r, tmp_path):
    imsave(tmp_path / "models.png", np.zeros((40, 60)))
    write_page(tmp_path, "made up", REPORT, made_up_run(arm_6r))
    page = open_page(tmp_path / "report.html", scripts=False).page
    assert page.locator(".pictures img").is_visible()
    assert page.locator("#scene, #map, .runs").locator("visible=true").count() == 0
    assert page.locator(".answer").is_visible()
