"""The walls of the house: truth and model share no code, and each heavy package has one door."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "testbench"
DOORS = {
    "mujoco": lambda p: p.parts[0] == "plant",
    "pinocchio": lambda p: p == Path("model/vjm.py"),
    "rerun": lambda p: p.parts[:2] == ("views", "recording"),
    "clarabel": lambda p: p.parts[0] == "identify",
    "matplotlib": lambda p: "figure" in p.name,
}


def imports(file):
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def modules():
    return {p.relative_to(PACKAGE): set(imports(p)) for p in PACKAGE.rglob("*.py")}


@pytest.mark.parametrize("package", DOORS)
def test_each_heavy_package_has_one_door(package):
    users = {p for p, names in modules().items() if any(n.split(".")[0] == package for n in names)}
    assert users
    assert all(DOORS[package](p) for p in users), users


def reaches(start, graph):
    seen, todo = set(), [start]
    while todo:
        for name in graph.get(todo.pop(), ()):
            if name not in seen:
                seen.add(name)
                todo.append(name)
    return seen


def test_plant_and_vjm_never_import_each_other_not_even_through_others():
    def name(path):
        return "testbench." + ".".join(path.with_suffix("").parts)

    graph = {name(p): {n for n in names if n.startswith("testbench")} for p, names in modules().items()}
    for module in [m for m in graph if m.startswith("testbench.plant")]:
        assert not any(n.startswith("testbench.model.vjm") for n in reaches(module, graph)), module
    assert not any(n.startswith("testbench.plant") for n in reaches("testbench.model.vjm", graph))
    assert not any(n.startswith("testbench.plant") for n in reaches("testbench.model.loaded", graph))
    assert not any(n.startswith("testbench.plant") for n in reaches("testbench.identify.conic", graph))


def test_nothing_dangerous_is_imported():
    banned = {"pickle", "marshal", "shelve", "dill"}
    assert not [p for p, names in modules().items() if {n.split(".")[0] for n in names} & banned]
