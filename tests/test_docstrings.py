"""Docstrings: read alone, each says what a caller gives and gets."""

import ast
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

LIBRARY = Path(__file__).resolve().parents[1] / "testbench"
ROOMS = tuple("arm model plant data identify design correct files workflows studies report runs cli".split())
BELOW = set("arm model plant data identify design correct".split())
"""The library: what a user calls from Python."""
DRAWN = re.compile(r"report/(recording/.*|scene|colours|figure.*|run_figure)\.py")
"""Modules that draw, whose docstrings are still to be read."""
NO_VERBS = set(
    "a an the all as at by each how its no of one that this those what where whether which whose why rows "
    "flags numbers errors poses models every rms columns parameters sentences root readings 5th base "
    "cells chi draws does entry estimates follows friction gaps heading keys kinds labels legs places "
    "plain rivals real seeds shown some springs tip trials type versions weights when words workers world "
    "yes another covariance different frame gravity length median names orientation orthonormal other "
    "robustly rotation size smallest symmetric unit upper usual whitened".split()
)
NOUN = re.compile(r"[a-z]+[^s]s|.*\W.*")
"""A first word that is a plural, or no word at all, such as "Readings" or "R^T"."""
ARGS = re.compile(r"^Args:\n((?:(?:    .*)?\n?)*)", re.MULTILINE)
NAME = re.compile(r"^    \*{0,2}(\w+):", re.MULTILINE)
GIVES = re.compile(r"^(?:Returns|Yields):$", re.MULTILINE)
NOTHING = {None, "None", "NoReturn"}
NUMBERS = re.compile(r"\b(Array|Ids|Mask|float|int|None|Any|Callable|Iterator|dict)\b")
"""Types of results whose shape, unit or meaning only a docstring tells; other classes tell their own."""


def public(body, prefix=""):
    """Every public function and class under a body, with its dotted name."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from public(node.body, f"{prefix}{node.name}.")


def every_function(tree):
    """Every public function of a module, those within private classes and functions too."""
    functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
    return [node for node in functions if not node.name.startswith("_")]


@cache
def documented(room):
    """Every public function and class of a room: where, the node, its docstring."""
    every = sorted((LIBRARY / room).rglob("*.py"))
    paths = [path for path in every if not DRAWN.fullmatch(path.relative_to(LIBRARY).as_posix())]
    return [
        (f"{path.relative_to(LIBRARY)}: {name}", node, ast.get_docstring(node) or "")
        for path in paths
        for name, node in public(ast.parse(path.read_text(encoding="utf-8")).body)
    ]


def arguments(node):
    spec = node.args
    every = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs, spec.vararg, spec.kwarg]
    return {each.arg for each in every if each} - {"self", "cls"}


def _is_command(place):
    """A command's arguments are its flags, each with its help."""
    return place.startswith("cli/") and place.endswith(": command")


@pytest.mark.parametrize("room", ROOMS)
def test_a_function_lists_its_arguments_and_what_it_returns(room):
    """Those of two or more; one argument and its result may be in the summary, with shape and unit.

    Of the library one that returns an object of a class of its own may leave out `Returns`.
    """
    wrong = []
    for place, node, text in documented(room):
        if isinstance(node, ast.ClassDef) or len(arguments(node)) < 2 or _is_command(place):
            continue
        listed = ARGS.search(text)
        names = set(NAME.findall(listed[1])) if listed else set()
        gives = ast.unparse(node.returns) if node.returns else None
        silent = gives in NOTHING or (room in BELOW and not NUMBERS.search(gives))
        if names != arguments(node) or not (silent or GIVES.search(text)):
            wrong.append(f"{place}: {sorted(arguments(node) ^ names) or 'Returns'}")
    assert not wrong


def _raises(node):
    """Tell whether a function raises an error itself, not in a function within it."""
    if isinstance(node, ast.FunctionDef | ast.Lambda):
        return False
    return isinstance(node, ast.Raise) or any(_raises(child) for child in ast.iter_child_nodes(node))


@pytest.mark.parametrize("room", sorted(BELOW))
def test_a_function_of_the_library_lists_what_it_raises(room):
    functions = [each for each in documented(room) if isinstance(each[1], ast.FunctionDef)]
    raising = {place: text for place, node, text in functions if any(map(_raises, node.body))}
    assert not [place for place, text in raising.items() if "\nRaises:\n" not in text]


def _trees(room):
    every = sorted((LIBRARY / room).rglob("*.py"))
    return [(path.relative_to(LIBRARY), ast.parse(path.read_text(encoding="utf-8"))) for path in every]


@pytest.mark.parametrize("room", sorted(BELOW))
def test_a_method_of_the_library_lists_its_arguments_too(room):
    """One argument beside `self` is enough, and functions within functions count."""
    wrong = []
    for path, tree in _trees(room):
        for node in every_function(tree):
            every = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            listed = ARGS.search(ast.get_docstring(node) or "")
            if len(every) > 1 and (not listed or set(NAME.findall(listed[1])) != arguments(node)):
                wrong.append(f"{path}:{node.lineno} {node.name}")
    assert not wrong


@pytest.mark.parametrize("room", ROOMS)
def test_a_docstring_begins_with_a_verb(room):
    first = {place: [*text.lower().split(), ""][0].strip(",.:") for place, _, text in documented(room)}
    assert not {place: word for place, word in first.items() if not word or word in NO_VERBS}


@pytest.mark.parametrize("room", sorted(BELOW))
def test_a_private_docstring_of_the_library_begins_with_a_verb_too(room):
    wrong = []
    for path, tree in _trees(room):
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef | ast.ClassDef) or not (text := ast.get_docstring(node)):
                continue
            word = text.lower().split()[0].strip(",.:")
            if word in NO_VERBS or NOUN.fullmatch(word):
                wrong.append(f"{path}:{node.lineno} {node.name}: {word}")
    assert not wrong


QUOTED = re.compile(r"`([A-Za-z_]\w*(?:\.\w+)*)(?:\(\))?`")
"""A name in backticks."""
FOREIGN = {"dataclasses", "savefig", "cal_offset", "panda_", "GlobalSearch", "py", "toml"}
"""Names of other programs, and suffixes of files."""


def test_names_in_backticks_exist():
    """A rename that forgets a docstring or a comment leaves a name that nobody finds."""
    known, said = set(FOREIGN), []
    for path in sorted(LIBRARY.rglob("*.py")):
        known |= set(path.with_suffix("").parts)
        with path.open("rb") as file:
            for token in tokenize.tokenize(file.readline):
                prose = token.type == tokenize.COMMENT or (
                    token.type == tokenize.STRING and "`" in token.string
                )
                if prose:
                    said += [(f"{path.name}:{token.start[0]}", name) for name in QUOTED.findall(token.string)]
                elif token.type in (tokenize.NAME, tokenize.STRING):
                    known |= set(re.findall(r"\w+", token.string))
    assert len(said) > 100
    assert not [f"{place}: {name}" for place, name in said if not set(name.split(".")) <= known]
