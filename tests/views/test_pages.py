"""Numbers in hand-written pages: those between marks are a run's, and no other is typed."""

import csv
import json
import re
from pathlib import Path

import pages
import pytest
import write_paper
from blocks import FROM, PLAIN, expected, fill
from read_reports import read_report
from run_here import app_of, here, numbers_alone
from stamps import digest, read_stamp
from words import SHARE, long_sentences, sentences
from words import pages as all_pages

from testbench import __version__
from testbench.errors import InputError
from testbench.report.markdown import grid
from testbench.runs.spread import Spread
from testbench.studies.paper.loaded_stiffness import STUDY
from testbench.studies.paper.verdicts import number, statement_row, verdict_table

ROOT = Path(__file__).resolve().parents[2]
GENERATED = ("paper.md", "wrong_inputs.md")
MEASURED = re.compile(r"\d\.\d+ (?:mm|um|ms|s|times)\b|\d us\b|\d\.\d+ ?%")
"""What a measured number looks like: decimals with a unit."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    app = app_of(ROOT / "scenarios" / "loaded_stiffness.py")
    with numbers_alone():
        done = here(app, "--seed", 3, "--out", folder / "loaded_stiffness", "--quick", "--workers", 1)
    assert done.returncode == 0, done.stderr
    return folder


def page(tmp_path, text):
    file = tmp_path / "page.md"
    file.write_text(text)
    return file


def test_a_mark_holds_the_words_and_tables_of_its_run_and_nothing_beside_it_changes(runs, tmp_path):
    text = "Before 1.5 mm.\n\n<!-- from loaded_stiffness: title; by_load -->\nold\n<!-- end -->\n\nAfter.\n"
    own = page(tmp_path, text)
    assert fill(own, runs, tmp_path / "none.json")
    found, report = own.read_text(), read_report(runs / STUDY.name / "report.json")
    inside = f"{report.block('title')}\n\n{grid(report.tables['by_load'])}"
    assert found == text.replace("old\n", f"{inside}\n\n")
    assert fill(own, runs, tmp_path / "none.json")
    assert own.read_text() == found  # once more changes nothing


def test_what_did_not_run_stays_as_it_was(runs, tmp_path):
    text = "<!-- from single_link: title -->\nold\n<!-- end -->\n<!-- bench -->\nbars\n<!-- end -->\n"
    own = page(tmp_path, text)
    fill(own, runs, tmp_path / "none.json")
    assert own.read_text() == text


@pytest.mark.parametrize(
    ("mark", "said"),
    [
        ("from no_such_study: title", "no study 'no_such_study'"),
        ("from loaded_stiffness: no_part", "no such block, and no such table; tables are by_load"),
    ],
)
def test_a_wrong_mark_is_one_line(runs, tmp_path, mark, said):
    with pytest.raises(InputError, match=said):
        fill(page(tmp_path, f"<!-- {mark} -->\n<!-- end -->\n"), runs, tmp_path / "none.json")


def test_bars_are_those_of_the_benchmark(runs, tmp_path):
    rows = [
        {"benchmark": "a over b", "value": 2.345, "unit": "x", "bar": 3.5, "at_least": False},
        {"benchmark": "c", "value": 12.0, "unit": "ms", "bar": None, "at_least": True},
    ]
    bench = tmp_path / "bench.json"
    bench.write_text(json.dumps({"results": rows, "machine": {"processor": "some core"}}))
    own = page(tmp_path, "<!-- bench -->\n<!-- end -->\n")
    fill(own, runs, bench)
    assert "Medians of one run on one thread of some core." in own.read_text()
    table = (tmp_path / "tables" / "speed.csv").read_text()
    assert table == "what,measured,bar\na over b,2.35 x,at most 3.5\n"  # c has no bar to hold


@pytest.mark.parametrize(
    "file", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda p: p.name
)
def test_no_measured_number_is_typed_by_hand(file):
    if file.name in GENERATED:
        return
    text = PLAIN.sub("", FROM.sub("", file.read_text()))
    text = re.sub(r"<!-- demo -->.*?<!-- end -->|```.*?```", "", text, flags=re.DOTALL)
    lines = [line for line in text.splitlines() if not line.startswith("    ")]
    typed = [m[0] for line in lines for m in MEASURED.finditer(line)]
    assert not typed


def test_page_tables_and_picture_of_a_study_are_of_one_run(runs, tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "PAGES", tmp_path)
    pages.page(STUDY.name, runs / STUDY.name)
    found = read_stamp(tmp_path / f"{STUDY.name}.png")
    assert found.numbers == digest(tmp_path / STUDY.name)
    assert f"    {found.command}\n" in (tmp_path / f"{STUDY.name}.md").read_text()


def test_readme_expects_what_the_tables_of_the_studies_hold():
    assert expected() in (ROOT / "README.md").read_text()
    with (ROOT / "docs/studies/gravity_calibration/models.csv").open() as file:
        rows = {row["model"]: row["RMS workspace, true, mm"] for row in csv.DictReader(file)}
    cells = [cell.split()[0] for cell in expected().splitlines()[3].split("|")[2:7]]
    assert cells == [
        rows[name] for name in ("ALL153 + prior", "LS153 + prior", "Joints", "MLS56 + prior", "MLS56")
    ]
    default, same_prior, _ = (cell.split()[0] for cell in expected().splitlines()[6].split("|")[2:5])
    answer = f"the default model {default} mm; least squares with the same prior {same_prior} mm."
    assert answer in (ROOT / "docs/studies/compensation.md").read_text()


def test_who_cites_the_software_cites_its_version():
    for name, line in (
        ("CITATION.cff", f"version: {__version__}"),
        ("docs/article.md", f"version = {{{__version__}}}"),
    ):
        assert re.search(rf"^ *{re.escape(line)},?$", (ROOT / name).read_text(), re.MULTILINE), name


def test_the_page_of_the_paper_has_every_line_of_its_template_in_turn():
    """Those without a number: a page that was changed by hand, or not written anew, is found."""
    template = (ROOT / "docs/paper.md.in").read_text()
    fixed = [line for line in template.splitlines() if line and not re.search(r"\{[{%]", line)]
    assert len(fixed) > 50
    page = iter((ROOT / "docs/paper.md").read_text().splitlines())
    assert [line for line in fixed if line not in page] == []


def test_statements_in_words_are_those_without_a_number_of_the_paper():
    rows = [number("RMS, mm", Spread(0.2, 0.1, 0.3), 0.15), statement_row("GCO is conservative", True, 1.0)]
    found = write_paper.in_words(verdict_table(rows))
    assert [row.claim for row in found.rows] == ["GCO is conservative"]
    assert [column.key for column in found.columns] == ["claim", "holds", "verdict"]
    assert [column.key for column in write_paper.only(found, "claim verdict").columns] == [
        "claim",
        "verdict",
    ]


def test_verdicts_of_the_article_are_those_of_the_studies():
    """Between marks that `make paper` fills."""
    found = re.findall(r"<!-- from (\w+): badge -->\n(.*?)\n", (ROOT / "docs/article.md").read_text())
    assert len(found) > 5
    for name, badge in found:
        assert f"\n> {badge}\n" in (ROOT / f"docs/studies/{name}.md").read_text(), name


def test_words_counts_sentences_of_prose_alone():
    code = "    code. code.\n\n```sh\nx. y.\n```\n"
    text = (
        f"# Title\n\nOne two. Three [four](five.md)!\n\n- six\n- seven\n\n| a. b |\n\n$$\na. b.\n$$\n\n{code}"
    )
    assert sentences(text) == ["One two.", "Three four!", "- six", "seven"]


def test_few_sentences_of_the_docs_are_long():
    counted = [long_sentences(page) for page in all_pages()]
    assert len(counted) > 60
    assert sum(len(beyond) for beyond, _ in counted) <= SHARE * sum(every for _, every in counted)
