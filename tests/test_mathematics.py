"""docs/mathematics: equations and functions name each other; constants and tables are the code's."""

import ast
import csv
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from testbench.identify.regression import generic_observation_matrix, rank
from testbench.model import structure as structures
from testbench.model.load import first_order_deflection, one_step_theta, weight
from testbench.model.vjm import evaluate_chain, observation_matrix

ROOT = Path(__file__).resolve().parents[1]
PAGES = {page.stem: page.read_text(encoding="utf-8") for page in (ROOT / "docs/mathematics").glob("*.md")}
LIBRARY = ("arm", "model", "plant", "identify", "design", "correct", "studies")
EQUATION = re.compile(r"^\$\$\n.+?\n\$\$ \(([^)]+)\)\n\n([^\n]*)$", re.DOTALL | re.MULTILINE)
NAME = re.compile(r"`(testbench\.[\w.]+)`")
BUILDERS = "all153 mgco147 mgco69 mgco68 mgco47 template56 joints_only".split()


def equations(page):
    """Label of every equation, and the functions that compute it."""
    return {label: NAME.findall(line) for label, line in EQUATION.findall(PAGES[page])}


def rows(page, first):
    """Cells of the rows of a table whose head begins with a word."""
    table = re.search(rf"^\| {first} \|.*\n\|[-:| ]+\|\n((?:\|.*\n)+)", PAGES[page], re.MULTILINE)
    return [[cell.strip() for cell in line.strip("| ").split("|")] for line in table[1].splitlines()]


def documented(path):
    """Pairs of a function and a label that its docstring names, of one module."""
    text = path.read_text(encoding="utf-8")
    if "Mathematics: `" not in text:
        return
    todo = [(".".join(path.relative_to(ROOT).with_suffix("").parts), ast.parse(text))]
    while todo:
        name, node = todo.pop()
        inner = (own for own in node.body if isinstance(own, ast.FunctionDef | ast.ClassDef))
        todo += [(f"{name}.{own.name}", own) for own in inner]
        for line in re.findall(r"^Mathematics: (.*)\.$", ast.get_docstring(node) or "", re.MULTILINE):
            yield from ((name, label) for label in re.findall(r"`(.+?)`", line))


def test_equations_and_functions_name_each_other():
    named = {(name, label) for page in PAGES for label, names in equations(page).items() for name in names}
    modules = (path for room in LIBRARY for path in (ROOT / "testbench" / room).rglob("*.py"))
    assert named == {pair for path in modules for pair in documented(path)}


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"index", "constants"}))
def test_every_equation_has_a_label_in_turn_and_a_function(page):
    found = equations(page)
    prefix = next(iter(found)).partition("-")[0]
    opened = len(re.findall(r"^\$\$$", PAGES[page], re.MULTILINE))  # an equation without a label opens two
    assert list(found) == [f"{prefix}-{k + 1}" for k in range(opened)]
    assert all(found.values())


def test_constants_have_the_values_and_places_of_the_tables():
    files = sorted((ROOT / "docs/mathematics/constants").glob("*.csv"))
    assert [f":file: constants/{file.name}" in PAGES["constants"] for file in files] == [True] * len(files)
    table = [row for file in files for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines())]
    assert len(table) > 70
    for row in table:
        name, values = row["constant"].strip("`"), [float(x) for x in row["value"].split(",")]
        module, _, constant = name.rpartition(".")
        found = np.ravel(getattr(importlib.import_module(f"testbench.{module}"), constant))
        np.testing.assert_allclose(found, values, rtol=1e-4, err_msg=name)
        assert row["evidence"]


def test_coverage_by_kind_is_that_of_the_study():
    with (ROOT / "docs/studies/model_error/kinds.csv").open(encoding="utf-8") as file:
        found = {
            row["true arms"]: [row["trials"], row["covered, %"], row["in the worst tenth, %"]]
            for row in csv.DictReader(file)
        }
    table = rows("intervals", "true arms")
    assert len(table) > 3
    assert all(found[kind] == covered for kind, *covered in table)


def test_ranks_of_the_page_are_those_of_the_arm(kr500, rng):
    """They do not depend on the draw: of the full load, of a weight in many poses, in eight."""
    q = kr500.arm.draw_poses(rng, 40)
    load, where = weight(kr500.vjm, 460.3).for_poses(len(q)), evaluate_chain(kr500.vjm, q)
    for name, *numbers in rows("observation", "structure"):
        s = next(own for own in (getattr(structures, own)(kr500.arm) for own in BUILDERS) if own.name == name)
        A = observation_matrix(where, s, load.wrench, load.point, kr500.vjm.markers)
        found = [
            s.n_parameters,
            rank(generic_observation_matrix(kr500.vjm, s)),
            *(rank(A[:k].reshape(-1, s.n_parameters)) for k in (40, 8)),
        ]
        assert found == [int(x) for x in numbers], name


def test_the_worked_example_sinks_by_what_the_page_says(kr500):
    q, load = np.radians([[0.0, -60, 80, 0, 40, 0]]), weight(kr500.vjm, 460.3).for_poses(1)
    where = evaluate_chain(kr500.vjm, q)
    sunk = -1e3 * first_order_deflection(
        where,
        one_step_theta(where, kr500.arm.C_theta, load.wrench, load.point),
        kr500.vjm.markers,
    )
    assert re.search(r"marker 1 sinks by ([\d.]+) mm", PAGES["vjm"])[1] == f"{sunk[0, 0, 2]:.3f}"
