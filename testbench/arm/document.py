"""TOML and XML files of users: strict parsing, and the place of a value in the file for error messages."""

import os
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from testbench.errors import InputError, read_text, shorten

DECIMAL_PATTERN = re.compile(r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$")
"""Pattern of a decimal number, with a point as decimal mark."""
INTEGER_PATTERN = re.compile(r"^[+-]?[0-9]{1,19}$")  #: Pattern of an integer of up to 19 digits.
NUMBER_EXAMPLES = "such as 12, -0.5 or 2e-3"  #: Examples of numbers, for error messages.
MAX_DECIMAL_CHARACTERS = 400  #: Most characters of a number: 17 digits hold all that a double does.


def is_decimal(text: str) -> bool:
    """Tell whether a text is a decimal number in ASCII digits, such as -0.5 or 2e-3, and not too long."""
    return len(text) <= MAX_DECIMAL_CHARACTERS and DECIMAL_PATTERN.fullmatch(text) is not None


def is_integer(text: str) -> bool:
    """Tell whether a text is an integer of 64 bits in ASCII digits."""
    return INTEGER_PATTERN.fullmatch(text) is not None and -(2**63) <= int(text) < 2**63


def read_decimals(texts: Iterable[str]) -> list[float]:
    """Convert texts to numbers; a number too large for a double becomes infinite.

    Args:
        texts: Decimal numbers as text, such as "-0.5" or "2e-3".

    Returns:
        The numbers, in order.

    Raises:
        ValueError: At the first text that is no number.
    """
    texts = list(texts)
    for word in texts:
        if not is_decimal(word):
            raise ValueError(f"expected a number {NUMBER_EXAMPLES}, got {word[:80]!r}")
    return list(map(float, texts))


MAX_TOML_BYTES = 16_000_000  #: Largest TOML file in which the place of a key is found [byte].
TABLE_HEADER_PATTERN = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
KEY_PATTERN = re.compile(r"\s*([\w.-]+)\s*=")  #: Pattern of the key in a line of TOML.

KeyPath = tuple[str | int, ...]
"""Keys of nested tables, and indices into arrays from 0."""


def toml_place(path: Path, keys: Sequence[str | int]) -> str:
    """Find line, column and name of a value in a TOML file, or of the table that lacks it.

    Args:
        path: The file, already read once.
        keys: Names of tables and keys, and indices into arrays from 0, such as ("link", 0, "name").

    Returns:
        The place as text, such as "line 12, column 1, link.0.name"; the keys alone if it cannot be found.
    """
    table: KeyPath = ()
    seen: dict[str, int] = {}
    best, place = 0, ""
    for number, line in enumerate(_lines(path), start=1):
        if header := TABLE_HEADER_PATTERN.match(line):
            table = _table_keys(header[2], seen, array=header[1] == "[[")
            here, start = table, header.start(2)
        elif key := KEY_PATTERN.match(line):
            here, start = (*table, *key[1].split(".")), key.start(1)
        else:
            continue
        if len(here) > best and here == tuple(keys[: len(here)]):
            best, place = (
                len(here),
                f"line {number}, column {_place_in_line(line, start, keys[len(here) :]) + 1}, ",
            )
    return place + ".".join(map(str, keys))


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path, MAX_TOML_BYTES).splitlines()
    except InputError:  # it has changed since it was read
        return []


def _table_keys(name: str, seen: dict[str, int], *, array: bool) -> KeyPath:
    """Return the keys of a table from its header; in an array of tables those of the last one opened."""
    if array:
        seen[name] = seen.get(name, -1) + 1
    path: KeyPath = ()
    parts = name.split(".")
    for k, part in enumerate(parts, start=1):
        whole = ".".join(parts[:k])
        path = (*path, part, seen[whole]) if whole in seen else (*path, part)
    return path


def _place_in_line(line: str, start: int, keys: Sequence[str | int]) -> int:
    """Find where keys of an inline table stand in a line, as far as they are there."""
    for key in keys:
        match = re.search(rf"\b{re.escape(str(key))}\s*=", line[start:])
        if not match:
            break
        start += match.start()
    return start


class StrictModel(BaseModel):
    """Define strict pydantic models: unknown keys and NaN are refused, and no type is converted."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


MAX_SHOWN_LENGTH = 80  #: Most characters of a name or value that a message repeats.
EXPECTED_TEXTS: Mapping[str, str] = {
    "missing": "this key is missing",
    "extra_forbidden": "unknown key",
    "string_type": "expected a text",
    "string_too_short": "expected a text that is not empty",
    "string_too_long": "expected a text of at most {max_length} characters",
    "int_type": "expected an integer",
    "int_parsing": "expected an integer",
    "float_type": "expected a number",
    "float_parsing": "expected a number",
    "finite_number": "expected a finite number",
    "bool_type": "expected true or false",
    "literal_error": "expected {expected}",
    "greater_than": "expected more than {gt}",
    "greater_than_equal": "expected at least {ge}",
    "less_than": "expected less than {lt}",
    "less_than_equal": "expected at most {le}",
    "list_type": "expected a list",
    "tuple_type": "expected a list",
    "too_short": "expected a list of at least {min_length}",
    "too_long": "expected a list of at most {max_length}",
    "dict_type": "expected a table, written as {{ key = value, ... }}",
    "model_type": "expected a table, written as {{ key = value, ... }}",
}
"""Message by pydantic's error type; other types keep pydantic's own message."""


class InvalidValue(NamedTuple):
    """Hold a value of a document that pydantic refuses: its place, the error type and a message."""

    keys: KeyPath  #: Keys and indices that lead to the value.
    error_type: str  #: Error type of pydantic, such as "missing".
    problem: str  #: What was expected, and what the document has.


def first_invalid_value(err: ValidationError) -> InvalidValue:
    """Find the first value that pydantic refuses, with a message of one line.

    Args:
        err: The error that pydantic raised for the document.

    Returns:
        Place, error type and message of the value.
    """
    try:
        first = err.errors(include_url=False)[0]
        got = repr(first["input"])
    except (RecursionError, ValueError):  # too deep, or of too many digits, to be shown
        first = err.errors(include_url=False, include_input=False)[0]
        got = "something too long to show"
    kind = first["type"]
    problem = EXPECTED_TEXTS.get(kind, "").format_map(first.get("ctx", {}))
    problem = problem or first["msg"].removeprefix("Value error, ")
    if kind not in ("missing", "extra_forbidden"):
        problem += f", got {shorten(got, MAX_SHOWN_LENGTH)}"
    return InvalidValue(tuple(key for key in first["loc"] if key != "[key]"), kind, problem)


FORBIDDEN_FIRST_CHARACTERS = "=+-@'"
"""Characters that no name begins with: spreadsheets compute such a cell, and commands take it for a flag."""


def text_matching(pattern: str, description: str) -> AfterValidator:
    """Make a pydantic check that a whole text matches a regular expression.

    Args:
        pattern: The regular expression.
        description: Words for the error message, such as "three numbers with commas between them".

    Returns:
        The check, to annotate the type of a field with.
    """

    def check_text(text: str) -> str:
        if not re.fullmatch(pattern, text, re.DOTALL):
            raise ValueError(f"expected {description}")
        return text

    return AfterValidator(check_text)


def _check_name(name: str) -> str:
    """Refuse a name that does not print, has blanks at an end, or begins with a forbidden character."""
    if not name.isprintable() or name != name.strip() or name[0] in FORBIDDEN_FIRST_CHARACTERS:
        problem = (
            "expected printable characters, no blank at the ends, and a first character other than {unfit}"
        )
        raise PydanticCustomError("name", problem, {"unfit": " ".join(FORBIDDEN_FIRST_CHARACTERS)})
    return name


Name = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_check_name)]
"""Name of a body, joint or marker: 1 to 64 printing characters of any script."""


def path_inside(folder: Path, file: Path) -> Path | None:
    """Resolve the path of a file, and check that the file is inside a folder; symbolic links are followed.

    Args:
        folder: The folder.
        file: Path of the file, relative to the folder.

    Returns:
        The real path; None if it is outside the folder, or cannot be a path.
    """
    home = os.path.realpath(folder)
    try:
        real = Path(os.path.realpath(Path(home) / file))
    except ValueError:  # a zero byte
        return None
    return real if real.is_relative_to(home) else None


def unused_name(name: str, taken_names: Container[str]) -> str:
    """Make a name that is not taken, by appending underscores.

    Args:
        name: Wanted name.
        taken_names: Names in use.

    Returns:
        The name, unchanged if it is not in use.
    """
    while name in taken_names:
        name += "_"
    return name


TOML_HINTS = {
    "Invalid value": "; a text needs quotation marks",
    "Cannot overwrite": "; the key is there twice",
    "Cannot declare": "; the table is there twice",
}
"""Ways out of some errors of the parser."""


def parse_toml(path: Path, text: str) -> dict[str, object]:
    """Parse the text of a TOML file.

    Args:
        path: The file, for messages.
        text: Its text.

    Returns:
        Its tables and values by key.

    Raises:
        InputError: When it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as err:  # also an integer of thousands of digits
        hint = next((hint for text, hint in TOML_HINTS.items() if text in str(err)), "")
        raise InputError(path, "", f"not TOML: {err}{hint}") from err


MAX_ELEMENTS = 20_000  #: Most elements of an XML file.
MAX_NESTING = 150  #: Most elements within each other.


def parse_xml(path: Path, text: str) -> ET.Element:
    """Parse the text of an XML file.

    Args:
        path: The file, for messages.
        text: Its text.

    Returns:
        Its root element; tags in the root's namespace are without it.

    Raises:
        InputError: When it is not well-formed, too large, defines entities, or has an attribute that contains
            nan: MuJoCo would print a warning, and write it into a file.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, "", "document types and entities are not allowed")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, LookupError, ValueError) as err:
        raise InputError(path, "", f"not well-formed XML: {err}") from err
    level, count = [root], 0
    for _ in range(MAX_NESTING + 1):
        count += len(level)
        level = [child for e in level for child in e]
    if level or count > MAX_ELEMENTS:
        problem = f"expected at most {MAX_ELEMENTS} elements, and at most {MAX_NESTING} nested elements"
        raise InputError(path, "", problem)
    space = root.tag.rpartition("}")[0]  # XML writes the namespace of the root before its tag
    for e in root.iter():
        if space:
            e.tag = e.tag.removeprefix(f"{space}}}")
        for key, value in e.attrib.items():
            if "nan" in [word.lstrip("+-") for word in value.lower().split()] and key != "name":
                owner = next((own for own in root.iter() if e in own and own.get("name")), None)
                place = xml_place(e, owner)
                raise InputError(path, place, f"{key}: expected numbers, got {value[:MAX_SHOWN_LENGTH]!r}")
    return root


def xml_place(element: ET.Element, ancestor: ET.Element | None = None) -> str:
    """Name an XML element for a message by its tag and name attribute, such as "<body name='link_2'>".

    Args:
        element: The element.
        ancestor: A named element that contains it; None for none.

    Returns:
        Tag and name; if the element has no name, after those of the ancestor.
    """
    name = element.get("name", "")[:MAX_SHOWN_LENGTH]
    own = f"<{element.tag} name={name!r}>" if name else f"<{element.tag}>"
    return own if name or ancestor is None or ancestor is element else f"{xml_place(ancestor)}: {own}"
