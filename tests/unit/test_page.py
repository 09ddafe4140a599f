"""What pages and terminals show: solids that close, text that stays text, numbers with their spread."""

import io
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from made_up_run import made_up_run
from rich.console import Console

import testbench
from testbench.plant.shapes import Mesh, Shape, visual_shapes
from testbench.report import page as html
from testbench.report import terminal
from testbench.report.colours import hexadecimal, look
from testbench.report.page import TRIANGLES, plain, seen_plain, solid
from testbench.report.scene import ModelLine, PlaceMap, RunChart
from testbench.report.schema import Table, TableColumn, brackets, looks
from testbench.report.table import Row
from testbench.report.terminal import grid, plain_console, print_table
from testbench.runs.spread import (
    Spread,
    dotted,
    inner,
    median_interval,
    spans,
    spread,
    wins,
)

SIZE = np.array([0.3, 0.3, 0.5])
VOLUMES = {
    "box": 8 * 0.3 * 0.3 * 0.5,
    "cylinder": np.pi * 0.3**2 * 1.0,
    "capsule": np.pi * 0.3**2 * 1.0 + 4 / 3 * np.pi * 0.3**3,
    "ellipsoid": 4 / 3 * np.pi * 0.3 * 0.3 * 0.5,
}
BAD = "<img src=x onerror=alert(1)>|a</script><script>alert(2)</script>"


def volume(vertices, faces):
    """By the divergence theorem: negative where triangles face inward, wrong where they do not close."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def shape(kind, mesh=None):
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return Shape(kind, 2, SIZE, np.array([1.0, 2, 3]), turn, np.array([1.0, 1, 1, 1]), mesh)


@pytest.mark.parametrize("kind", VOLUMES)
def test_a_shape_is_a_closed_surface_seen_from_outside_of_nearly_its_volume(arm_6r, kind):
    assert volume(*solid(shape(kind))) == pytest.approx(VOLUMES[kind], rel=0.06)
    assert all(volume(*solid(own)) > 0 for own in visual_shapes(arm_6r.room))


def test_a_mesh_of_many_triangles_becomes_one_of_few_and_keeps_its_volume():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    seams = np.repeat(vertices, 2, axis=0)  # corners twice, as of two normals
    places, thin = solid(
        shape("mesh", Mesh(seams, np.zeros_like(seams), 2 * faces + np.arange(len(faces))[:, None] % 2))
    )
    assert len(thin) <= 1.1 * TRIANGLES < len(faces)
    assert volume(places, thin) == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.06)
    np.testing.assert_allclose(places.mean(axis=0), [1, 2, 3], atol=0.05)


def test_what_a_stranger_calls_things_stays_text():
    table = Table(
        (TableColumn("name", "model"), TableColumn("x", "error", "mm")), [{"name": BAD, "x": 0.5}], BAD
    )
    words = dict.fromkeys(("badge", "question", "title", "answer", "worst", "statements"), BAD)
    rest = f"| a |\n| --- |\n| {BAD} |\n\n[go](javascript:alert(3)) ![see](http://far.example/x.png)"
    drawn = {"scene": None, "map": None, "runs": [{"title": BAD, "note": BAD}], "ramp": []}
    drawn["tables"] = [html.grid(table)]
    others = {"pictures": [{"name": BAD, "data": "data:,"}], "others": [BAD], "versions": {BAD: BAD}}
    page = html.fill(scenario=BAD, words=words, rest=rest, drawn=drawn, **others)
    assert "<img src=x" not in page
    assert page.count("<script") == page.count("</script") == 2  # the data and our own
    assert "javascript:alert" not in re.sub(r"\[go\]\(javascript:alert\(3\)\)", "", page)
    assert 'src="http' not in page
    [data] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    assert json.loads(data)["tables"][0]["rows"][0]["cells"][0]["text"] == BAD


def test_a_table_on_a_page_has_the_numbers_behind_its_words():
    rows = [{"name": "a", "x": Spread(1.0, 0.5, 2.0), "ok": True}, {"name": "b", "x": 3.0, "ok": None}]
    columns = (
        TableColumn("name", "model"),
        TableColumn("x", "error", "mm", ".1f"),
        TableColumn("ok", "solved", form="yes"),
    )
    found = html.grid(Table(columns, rows, bold="b", headline="x"))
    (_, other, _), (_, error, _) = (row["cells"] for row in found["rows"])
    assert error == {"text": "1.0 (0.5 to 2.0)", "v": 1.0, "low": 0.5, "high": 2.0}
    assert other == {"text": "3.0", "v": 3.0}
    assert [row["marked"] for row in found["rows"]] == [True, False]
    assert [head["drawn"] for head in found["head"]] == [False, True, False]
    firsts = [html.grid(Table(columns, rows, headline=key))["first"] for key in ("x", "ok", "")]
    assert firsts == [1, -1, -1]  # a chart opens on the headline if it can be drawn


def test_a_cell_of_many_trials_has_their_numbers_in_their_order_and_the_interval_of_the_median():
    values = np.random.default_rng(4).uniform(1, 2, 30)
    rows = [{"name": str(n), "x": spread(values[:n])} for n in (30, 5)]
    many, few = (
        row["cells"][1]
        for row in html.grid(Table((TableColumn("name", "model"), TableColumn("x", "x")), rows))["rows"]
    )
    assert many["dots"] == pytest.approx(values, rel=1e-3)
    assert (many["low"], many["high"]) == median_interval(values)
    assert (few["dots"], few["few"], "low" in few) == (pytest.approx(values[:5], rel=1e-3), True, False)


def test_what_is_no_number_stands_on_a_page_as_its_word_alone_and_is_left_out_of_charts_and_maps():
    nan = float("nan")
    numbers = [0.5, nan, float("inf"), Spread(nan, nan, nan), None]
    rows = [{"name": str(k), "x": number} for k, number in enumerate(numbers)]
    found = html.grid(Table((TableColumn("name", "model"), TableColumn("x", "error", "mm")), rows))
    cells = [row["cells"][1] for row in found["rows"]]
    assert [cell["text"] for cell in cells] == ["0.500", "not fitted", "infinite", "not fitted", "not fitted"]
    assert [row["cells"][1].get("v") for row in json.loads(html.data(found))["rows"]] == [0.5, *[None] * 4]
    line = ModelLine("a", look("MLS56", "none"), np.array([1.0, nan]))
    chart = RunChart("error (mm)", 0, "run", ["1", "2"], [line], limit=nan)
    places = PlaceMap("error (mm)", 0, np.array([[nan, 0, 0], [1.0, 2, 3]]), [line])
    chart, places = (json.loads(html.data(own)) for own in (plain(chart), plain(places)))
    assert chart["limit"] is None
    assert places["at"] == [None, [1, 2, 3]]
    assert [own["lines"][0]["values"] for own in (chart, places)] == [[1.0, None]] * 2


def test_a_table_on_a_page_has_the_words_of_its_models():
    rows = [Row(name=name, error=1.0) for name in ("MGCO56 + prior", "Joints", "random poses")]
    found = html.grid(Table((TableColumn("name", "model"), TableColumn("error", "error", "mm")), rows))
    words = ["GCO of beam links with prior (MGCO56)", "joints-only model", "random poses"]
    assert found["words"] == dict(zip((row.name for row in rows), words, strict=True))


def test_rows_that_are_no_model_have_no_models_colour():
    fits = [
        SimpleNamespace(case=case, structure=structure, constraint="none", prior=False)
        for case, structure in (("calm", "MLS56"), ("calm", "MLS32"), ("windy", "MLS56"))
    ]
    assert looks(fits, TableColumn("case", "case")) == {"windy": look("MLS56", "none")}


def test_a_page_has_the_poses_layers_and_words_that_picture_and_recording_have(arm_6r):
    seen = made_up_run(arm_6r)
    found = json.loads(html.data(seen_plain(seen)))
    assert (found["scene"]["title"], len(found["runs"])) == (seen.scene.title, 1)
    for own, group in zip(found["scene"]["groups"], seen.scene.groups, strict=True):
        assert (own["name"], own["names"], own["words"]) == (group.name, group.names, group.words)
        assert own["first"] == group.first
        places = np.reshape(own["rigid"], (len(group.names), -1, 7))[:, :, :3]
        np.testing.assert_allclose(places / 1e4, group.rigid.positions, atol=6e-5)
        for layer, wanted in zip(own["layers"], group.layers, strict=True):
            assert (layer["name"], layer["kind"], layer["shown"]) == (wanted.name, wanted.kind, wanted.shown)
            assert layer["colour"] == hexadecimal(wanted.colour)
            for key, ends in (("at", wanted.at), ("to", wanted.to)):
                read = np.nan if ends is None else np.array(layer[key], float) / 1e4
                np.testing.assert_allclose(
                    read, np.nan if ends is None else ends.reshape(len(ends), -1), atol=6e-5
                )
    [line] = found["map"]["lines"]
    values = [math.nan if x is None else x for x in line["values"]]
    np.testing.assert_allclose(values, seen.map.lines[0].values, rtol=1e-3)
    assert (found["map"]["group"], line["colour"]) == (1, seen.map.lines[0].look.hex)


def test_a_spread_is_numpys_percentiles_to_the_bit(rng):
    many = [10.0 ** rng.integers(-9, 9) * rng.standard_normal(n) for n in range(1, 60)]
    for values in (*many, [1.0, np.nan, 2.0], [True, False, True], [3, 1, 2, 2]):
        own = spread(values)
        wanted = np.percentile(np.asarray(values, dtype=float), [50, 5, 95])
        np.testing.assert_array_equal([own.median, own.p05, own.p95], wanted)


def test_of_few_trials_the_ends_are_the_range_and_of_twenty_percentiles():
    """Percentiles of three numbers are no percentiles; report.json has both, with the number of trials."""
    few, many = spread([1.0, 2.0, 9.0]), spread(np.arange(20.0))
    assert (few.ends, few.trials, few.least, few.most) == ((1.0, 9.0), 3, 1.0, 9.0)
    assert many.ends == (many.p05, many.p95) == (pytest.approx(0.95), pytest.approx(18.05))
    assert few.scaled(2.0).ends == (2.0, 18.0)
    assert spans([few, many, 1.0]) == "5 to 95 %, or the range of fewer than 20 trials"
    assert (spans([few]), spans([many]), spans([1.0])) == ("range of 3 trials", "5 to 95 % of 20 trials", "")


@pytest.mark.parametrize(("trials", "words"), [(3, "range of 3"), (20, "5 to 95 % of 20")])
def test_a_page_says_of_few_trials_that_brackets_hold_their_range(trials, words):
    rows = [{"name": "a", "x": spread(np.arange(float(trials)))}]
    table = Table((TableColumn("name", "model"), TableColumn("x", "error", "mm")), rows)
    assert html.grid(table)["brackets"] == brackets(table) == f"{words} trials"
    assert ("  5 %" in terminal.grid(table).columns[0].cells) == (trials == 20)


def test_a_picture_says_what_its_lines_are_where_there_are_no_dots():
    assert dotted([1.0]) == dotted([spread([1.0, 1.0])]) == ""
    assert dotted([Spread(2.0, 1.0, 3.0)]) == "lines: 5 to 95 %"


def test_a_spread_keeps_a_hundred_trials_of_all_kinds_and_the_interval_of_all_of_them():
    """Trials stand kind by kind, each with larger numbers than the last: dots are of all kinds alike."""
    values = np.sort(np.random.default_rng(2).uniform(1, 2, 250))
    own = spread(values).scaled(1000)
    assert len(own.values) == 100
    shares = [np.histogram(x, 4, ends)[0] for x, ends in ((own.values, (1000, 2000)), (values, (1, 2)))]
    np.testing.assert_allclose(shares[0], shares[1] / 2.5, atol=1)
    low, high = np.sort(values)[[109, 140]]  # the sign test's: 250 tosses are within 110 and 140 in 95 %
    assert own.interval == (1000 * low, 1000 * high)
    assert inner(own) == own.interval
    assert inner(spread(values[:19])) is None
    assert inner(Spread(2.0, 1.0, 3.0)) == (1.0, 3.0)


def test_a_win_is_more_than_a_solvers_last_digits():
    assert wins([1.0, 1.0, 1.0 - 1e-9, 1.0 - 1e-5, 2.0], [1.0, 1.0 + 1e-9, 1.0, 1.0, 1.0]) == 1


STEERS = "a\x1b]0;b\x07\x9bc\u202ed\u200b"
SEEN = "a\ufffd]0;b\ufffd\ufffdc\ufffdd\ufffd"
NAMES = ("joint[/x]", "[red]two[/red]", "[bold]", ":bug:", "a\\[b]")
"""A closing tag of nothing, which ends a program that reads tags; tags and a picture's name, which vanish."""


def test_names_are_printed_as_they_are_but_for_what_steers_a_terminal(capsys):
    names = (*NAMES, STEERS)
    columns = (TableColumn("name", "model"), *(TableColumn("value", name) for name in names))
    rows = [{"name": name, "value": name} for name in names]
    console = plain_console()
    console.width = 300
    print_table(console, Table(columns, rows, title="".join(names), bold=NAMES[0]))
    console.print("".join(names), soft_wrap=True)
    title, head, *lines, last = capsys.readouterr().out.strip().splitlines()
    assert title.strip() == last == f"{''.join(NAMES)}{SEEN}"
    assert head.split() == ["model", *NAMES, SEEN]
    cells = [line.split()[-len(names) :] for line in lines[1:]]
    assert cells == [[name] * len(names) for name in (*NAMES, SEEN)]


def test_a_table_has_medians_and_below_them_the_ends_of_their_spread_and_the_papers_numbers():
    columns = (
        TableColumn("name", "model", called={"a": "model A"}),
        TableColumn("error", "RMS error", "mm", paper="error", short="RMS\nmm"),
        TableColumn("n", "trials", form=".0f", exact=True),
        TableColumn("solved", "solved", form="yes"),
        TableColumn("um", "bias", "um", form=".1f", scale=1e3, none="no load"),
    )
    errors, n = spread([1.0, 2.0, 4.0]), spread([3, 5, 9])
    rows = [
        Row(name="a", error=errors, n=n, solved=0.5, um=0.002, paper=Row(error=1.5)),
        Row(name="b", error=0.25, n=None, solved=True, um=None, paper=Row()),
    ]
    found = grid(Table(columns, rows, bold="b"))
    heads = [str(column.header) for column in found.columns]
    assert heads == ["model", "RMS\nmm", "trials", "solved", "bias\num"]
    assert list(zip(*(column.cells for column in found.columns), strict=True)) == [
        ("* b", "0.250", "not fitted", "yes", "no load"),
        ("model A", "2.000", "5", "50 %", "2.0"),
        ("  least of 3", "1.000", "", "", ""),
        ("  most", "4.000", "", "", ""),
        ("  paper", "1.5", "", "", ""),
    ]


def test_all_of_the_package_prints_by_it_but_for_bars():
    package = Path(testbench.__file__).parent
    makers = [p for p in package.rglob("*.py") if re.search(r"\b\w*Console\(", p.read_text(encoding="utf-8"))]
    assert sorted(makers) == [package / "report/terminal.py", package / "runs/follow.py"]


def test_a_table_has_six_columns_at_most_and_among_them_that_of_the_answer():
    columns = [TableColumn(f"c{k}", f"heading {k}") for k in range(9)]
    console = Console(width=80, file=io.StringIO())
    print_table(console, Table(tuple(columns), [Row({f"c{k}": "yes" for k in range(9)})], headline="c7"))
    assert re.findall(r"\d", console.file.getvalue()) == list("012347")
