"""The walls of the house: rooms on floors, one door for each heavy package, modules of a readable size."""

import ast
import re
import sys
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "testbench"
LIBRARY = {"arm", "model", "plant", "data", "identify", "design", "correct"}
"""Mechanics and statistics: used alone, they bring nothing of the application."""
FLOORS = (
    {"display", "errors", "progress"},
    {"arm", "registry"},
    {"data", "model"},
    {"plant", "identify"},
    {"design", "correct"},
    {"runs"},
    {"files"},
    {"workflows"},
    {"report"},
    {"studies"},
    {"cli"},
)
"""Rooms from the ground up; scenarios stand beside the command line."""
DOORS = {
    "mujoco": ("plant", "files/robot"),
    "pinocchio": ("model/kinematics.py", "files/robot/urdf.py"),
    "rerun": "report/recording",
    "clarabel": "identify/cone.py",
    "jinja2": ("report/page.py", "files/motion.py"),
    **dict.fromkeys(("markdown_it", "markupsafe"), "report/page.py"),
    "pyarrow": ("runs", "files/table.py", "report/table.py", "workflows/load_dataset.py"),
    "python_calamine": "files/text.py",
    "distributed": "runs/engine.py",
    "joblib": "runs/engine.py",
    "trimesh": "files/robot/meshes.py",
    "fast_simplification": "plant/shapes.py",
}
"""The folder or module that imports a heavy package; matplotlib has a test of its own."""
UNTYPED = """
    runs/manifest.py studies/paper/factorised.py report/join.py report/report.py
    report/table.py studies/run.py
    studies/study.py
    runs/engine.py runs/store.py runs/rows.py report/page.py report/schema.py
    report/recording/world.py
"""
"""Modules at the door of JSON or of a package without types: the only ones that may say Any."""


@cache
def modules():
    """Every module by its dotted name; not the public face, which imports a room when it is asked for."""
    paths = [p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py"]
    return {".".join(("testbench", *_parts(p))): p for p in paths}


def _parts(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


def place(path):
    return path.relative_to(PACKAGE).as_posix()


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path):
    return list(ast.walk(tree(path)))


@cache
def imports(path):
    """Everything that a module imports, inside functions too, by its full name."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: import by the full name"
            found |= {_full(node.module, alias.name) for alias in node.names}
    return frozenset(found)


def _full(module, name):
    return f"{module}.{name}" if f"{module}.{name}" in modules() else module


def room(module):
    return module.split(".")[1]


@cache
def arrows():
    """Which rooms a room imports."""
    found = {room(module): set() for module in modules()}
    for module, path in modules().items():
        found[room(module)] |= {room(n) for n in imports(path) if n in modules()} - {room(module)}
    return found


def test_every_room_stands_on_a_floor():
    assert sorted(arrows()) == sorted(name for floor in FLOORS for name in floor)


def test_imports_lead_down():
    """Hence no circle between rooms: each arrow ends on a lower floor."""
    level = {name: k for k, floor in enumerate(FLOORS) for name in floor}
    up = [
        f"{module} imports {name}"
        for module, path in modules().items()
        for name in imports(path)
        if name in modules() and room(name) != room(module) and level[room(name)] >= level[room(module)]
    ]
    assert up == []


def test_no_module_imports_itself_through_others():
    graph = {module: {n for n in imports(path) if n in modules()} for module, path in modules().items()}
    while True:
        free = {module for module, needed in graph.items() if not needed & graph.keys() - {module}}
        if not free:
            break
        graph = {module: needed for module, needed in graph.items() if module not in free}
    assert graph == {}


def test_every_module_is_used():
    """A merge can bring back a module that was deleted: nothing imports it, and no other test sees it."""
    paths = [*modules().values(), PACKAGE / "__init__.py"]
    used = {name for path in paths for name in imports(path)}
    by_name = ("cli", "studies")  # commands and studies are imported by their names
    assert not [
        module
        for module, path in modules().items()
        if path.stem != "__init__" and room(module) not in by_name and module not in used
    ]


def given(node):
    """Names that a statement of a module gives."""
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
    return [node.name] if hasattr(node, "name") else []


def test_no_module_gives_a_name_twice():
    """The second would be meant where the first is: of two modules that became one, a constant of both."""
    for path in modules().values():
        names = Counter(name for node in tree(path).body for name in given(node))
        assert not [f"{place(path)}: {name}" for name, count in names.items() if count > 1]


def reaches(start):
    seen, todo = set(), [start]
    while todo:
        for name in arrows()[todo.pop()] - seen:
            seen.add(name)
            todo.append(name)
    return seen


def at_once(path):
    """What a module imports when it is imported: not inside functions, nor for types alone."""
    todo, found = list(tree(path).body), set()
    while todo:
        node = todo.pop()
        if isinstance(node, ast.ImportFrom):
            found |= {_full(node.module, alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.dump(node.test):
            todo += node.body + node.orelse
    return found


def within_reach(command):
    """All modules that a command may need: every import of every module, also inside functions."""
    seen, todo = set(), [f"testbench.cli.{command}"]
    while todo:
        name = todo.pop()
        seen.add(name)
        todo += (imports(modules()[name]) & modules().keys()) - seen
    return seen


OTHERS = {
    "identify": {
        "absolute",
        "absolute_campaign",
        "campaign",
        "instruments",
        "plan",
        "plan_input",
        "program",
    },
    "predict": {"absolute", "absolute_campaign", "campaign", "instruments", "plan"},
    "compensate": {"absolute", "absolute_campaign", "campaign", "instruments", "plan"},
    "plan": {"absolute_campaign", "campaign"},
    "calibrate": {"absolute_campaign", "campaign"},
}
"""Workflows of other commands, by command."""


@pytest.mark.parametrize("command", OTHERS)
def test_a_command_reaches_no_workflow_of_another(command):
    """Not even through others, or inside functions: what two commands share has a module of its own."""
    seen = {name.rpartition(".")[2] for name in within_reach(command) if room(name) == "workflows"}
    assert sorted(OTHERS[command] & seen) == []


MOST_MODULES = {"identify": 90, "predict": 78, "compensate": 78, "check": 65, "simulate": 70, "data": 100}
MOST_MODULES |= {"plan": 100, "calibrate": 108}
"""Most modules that somebody has to know who changes a command, itself among them."""


@pytest.mark.parametrize("command", MOST_MODULES)
def test_a_command_is_understood_without_most_of_the_house(command):
    """By all imports, also inside functions and for types: a module that needs few others is read alone."""
    assert len(within_reach(command)) <= MOST_MODULES[command]


def test_no_module_imports_the_public_face_which_reaches_every_room():
    """But for the version that --version prints."""
    assert {place(path) for path in modules().values() if "testbench" in imports(path)} == {"cli/program.py"}


def imported(command, *others):
    """All of testbench that is imported when a command is called, and with other modules."""
    seen, todo = set(), [f"testbench.cli.{command}", *others]
    while todo:
        for name in (at_once(modules()[todo.pop()]) & modules().keys()) - seen:
            seen.add(name)
            todo.append(name)
    return seen


FITS_NOTHING = ("room identify", "room design", "room correct")
NOT_IMPORTED = {
    "check": (*FITS_NOTHING, "package scipy"),
    "simulate": FITS_NOTHING,
    "predict": ("room design", "module identify.method", "module identify.absolute.fit", "package scipy"),
    "compensate": ("room design", "module identify.method", "module identify.absolute.fit", "package scipy"),
}
"""What some commands never call: import of it took half of the time of check, a tenth of that of predict."""
VIEWS = "testbench.report.run_figure", "testbench.report.page", "testbench.report.recording.run"


@pytest.mark.parametrize("command", NOT_IMPORTED)
def test_a_command_imports_nothing_that_it_never_calls(command):
    """Nor do its figures, page and recording import scipy."""
    seen = imported(command)
    drawn = imported(command, *VIEWS) | {*VIEWS}
    found = {f"room {room(name)}" for name in seen} | {name.replace("testbench.", "module ") for name in seen}
    found |= {f"package {own.partition('.')[0]}" for name in drawn for own in at_once(modules()[name])}
    assert len(drawn) > 40
    assert sorted(found & {*NOT_IMPORTED[command]}) == []


def test_signals_are_heeded_before_anything_else_is_imported():
    """Ctrl-C while numpy is imported would end in a traceback."""
    names = at_once(modules()["testbench.runs.interrupt"])
    assert {name.partition(".")[0] for name in names} <= sys.stdlib_module_names


@pytest.mark.parametrize("model", ["model", "identify"])
def test_truth_and_model_share_no_code_not_even_through_others(model):
    assert model not in reaches("plant")
    assert "plant" not in reaches(model)
    shared = {
        "display",
        "errors",
        "progress",
        "registry",
        "arm",
        "data",
    }
    assert reaches("plant") & reaches(model) <= shared


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_the_library_reads_no_clock_prints_nothing_and_writes_no_file(name):
    """Only the arm's folder is read, by testbench.arm; a progress listener hears of long steps."""
    wrong = {"print", "open", "open_file", "write_text", "write_bytes", "savefig", "now", "monotonic"}
    wrong |= set() if name == "arm" else {"read_text", "read_bytes"}
    called = [
        f"{place(path)}: {_called(node)}"
        for module, path in modules().items()
        if room(module) == name
        for node in nodes(path)
        if isinstance(node, ast.Call) and _called(node) in wrong
    ]
    assert called == []


def _called(node):
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def users(package):
    """Modules that import a package."""
    return {place(p) for p in modules().values() if any(n.split(".")[0] == package for n in imports(p))}


@pytest.mark.parametrize("package", DOORS)
def test_each_heavy_package_has_one_door(package):
    found, doors = users(package), DOORS[package]
    doors = (doors,) if isinstance(doors, str) else doors
    assert found
    assert all(any(name == d or name.startswith(f"{d}/") for d in doors) for name in found), found


def declared():
    """Packages by what pyproject.toml needs them for, and those that the page of dependencies lists."""
    root = PACKAGE.parent
    about = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    project, groups = about["project"], about["dependency-groups"]
    wanted = {"run": project["dependencies"], **project["optional-dependencies"], **groups}
    names = {use: {re.match(r"[\w-]+", one)[0] for one in own} for use, own in wanted.items()}
    pages = [root / "docs" / "dependencies.md", *(root / "docs" / "tables").glob("packages_to_*.csv")]
    listed = "".join(page.read_text(encoding="utf-8") for page in pages)
    return names, set(re.findall(r"\[([\w-]+)\]\(https:", listed))


IMPORTED_AS = {
    **{"pinocchio": "pin", "rerun": "rerun-sdk", "rerun_cli": "rerun-sdk", "PIL": "pillow"},
    **{"markdown_it": "markdown-it-py", "python_calamine": "python-calamine"},
    **{"markupsafe": "jinja2", "pydantic_core": "pydantic"},  # these need them
    "fast_simplification": "fast-simplification",
}
"""Packages by the names under which they are imported, where these differ."""


def test_what_is_imported_is_installed_with_the_package():
    """Also inside functions: a package that only the tests or the documentation bring is missed by users."""
    names = {n.partition(".")[0] for path in modules().values() for n in imports(path)}
    names -= {"testbench", "_typeshed", *sys.stdlib_module_names}
    needed = {IMPORTED_AS.get(name, name) for name in names}
    found, _ = declared()
    assert needed <= found["run"] | found["cluster"]
    assert found["run"] <= needed | {"pycollada"}  # by it trimesh reads COLLADA


def test_the_page_of_dependencies_lists_every_package_and_no_other():
    found, listed = declared()
    assert sorted(listed) == sorted(set().union(*found.values()))


def test_only_modules_of_figures_import_matplotlib():
    found = users("matplotlib")
    assert found
    others = {"report/recording/run.py", "report/report.py"}  # the second only shortens its docstrings
    assert all("figure" in Path(name).stem or name in others for name in found), found


def test_any_is_said_at_the_door_of_untyped_things_only():
    said = {
        place(path)
        for path in modules().values()
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom) and "Any" in {a.name for a in node.names}
    }
    assert said == set(UNTYPED.split())


def test_nothing_dangerous_is_imported_or_called():
    for name in ("pickle", "marshal", "shelve", "dill"):
        assert users(name) == set()
    called = [
        f"{place(path)}: {node.func.id}"
        for path in modules().values()
        for node in nodes(path)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    ]
    assert not [call for call in called if call.endswith((": eval", ": exec", ": compile", ": __import__"))]
