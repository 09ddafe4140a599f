"""docs/notebook.ipynb runs, cell by cell, and shows what its words say."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest

NOTEBOOK = Path(__file__).parents[2] / "docs" / "notebook.ipynb"


@pytest.fixture(scope="module")
def ran():
    """Its names after the last cell, and what each cell shows."""
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setenv("MPLBACKEND", "Agg")
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    own, shown = {}, []
    for cell in cells:
        if cell["cell_type"] == "code":
            lines = ast.parse("".join(cell["source"]))
            if shows := isinstance(last := lines.body[-1], ast.Expr):
                lines.body[-1] = ast.Assign([ast.Name("_", ast.Store())], last.value)
            exec(compile(ast.fix_missing_locations(lines), "notebook", "exec"), own)
            if shows:
                shown.append(own["_"])
    monkeypatch.undo()
    return own, shown


def test_the_notebook_shows_its_objects_as_tables(ran):
    _, shown = ran
    tables = [thing._repr_html_() for thing in shown if hasattr(thing, "_repr_html_")]
    assert [table.split("<caption>")[1].split("</caption>")[0] for table in tables] == [
        "Cell",
        "Campaign",
        "Dataset",
        "Estimate",
    ]


def test_the_notebooks_dots_are_its_errors_and_the_prior_is_the_best(ran):
    own, _ = ran
    median = {name: np.median(mm) for name, mm in own["errors"].items()}
    assert min(median, key=median.get) == "GCO with prior"
    lines = own["axes"].get_lines()
    assert [line.get_xdata().tolist() for line in lines] == [mm.tolist() for mm in own["errors"].values()]
    assert 0.5 < own["inside"].mean() <= 1


def test_the_notebook_is_stored_without_outputs_and_linked():
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert all(not cell.get("outputs") for cell in json.loads(text)["cells"])
    assert len(text) < 20_000
    assert "notebook.ipynb" in (NOTEBOOK.parent / "index.md").read_text(encoding="utf-8")
