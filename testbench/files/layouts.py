"""Layouts: how known exports and logs are written, as one TOML file each in testbench/layouts."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import Field, ValidationError, model_validator

from testbench.arm.document import StrictModel, first_invalid_value, is_decimal, parse_toml, toml_place
from testbench.arm.folder import Arm
from testbench.errors import InputError, read_text
from testbench.files.mapping import FileLayout, Map, Text
from testbench.files.names import XYZ, find_unit, number_of, places, plain, split_unit, squeeze
from testbench.files.text import (
    BLANK,
    DELIMITERS,
    SEARCHED,
    SHEET,
    WIDEST,
    cells_in,
    filled_right,
    is_comment,
    read_letters,
    split_lines,
    units_in,
    width_of,
)

FOLDER = Path(__file__).parents[1] / "layouts"
MAX_BYTES = 20_000  #: Size of a layout [byte].
LOOKED_AT = 50  #: Rows of a table without a header whose cells are looked at.
LENGTH = re.compile(
    r"(?:units?|einheit(?:en)?|unit(?:é|e)s?|单位)[^\w]+(?:\w+\s*[=:]\s*)?(\w+)", re.IGNORECASE
)
TURNED = "rotation|orientation|quaternion|euler|.*error|velocity|acceleration"
BODIES = f"{TURNED}|rigidbody|bone"
OTHERS = [re.compile(words) for words in (f"{BODIES}|rigidbodymarker", BODIES, TURNED)]
"""Above an axis: it is not that of a marker. The first that leaves axes of whole targets counts."""

Kind = Literal["word", "number", "any", "..."]
MORE = "..."  #: Last of the kinds of cells: any others may follow.


class Fits(StrictModel):
    """Describe how a file of a layout is recognised: all conditions must hold."""

    #: Names that the header has, among others.
    header: list[Text] = Field(default=[], max_length=100)
    #: Words in the lines before the table, or in its comments.
    above: list[Text] = Field(default=[], max_length=100)
    #: Kinds of the cells in every row of a file without a header, one for each of `file.names`.
    cells: list[Kind] = Field(default=[], max_length=100)


class Ordered(StrictModel):
    """Describe columns of joints whose order is stated by other columns, as ROS publishes them."""

    names: Text  #: Columns of the joints' names, such as "name{n}".
    values: Text  #: Columns of their positions, such as "position{n}".


class ExportLayout(Map):
    """Describe a known export: a map, and the conditions under which it fits a file."""

    title: Text  #: Name in reports.
    source: str  #: Source of the facts about the format.
    facts: Literal["documentation", "public files", "common use"]  #: Kind of that source.
    holds: list[Literal["positions", "joints"]] = Field(min_length=1)
    fits: Fits
    length: Literal["m", "mm"] | None = None  #: Unit of lengths where neither file nor columns say it.
    angle: Literal["deg", "rad"] | None = None  #: Unit of joints that turn where their columns do not say it.
    times: list[Text] = Field(default=[], max_length=100)  #: Columns that together state the time of a row.
    joints: Ordered | None = None
    #: Where the targets of columns X, Y, Z are named: "above" them, or behind this word in a line above.
    targets: Text | None = None

    @model_validator(mode="after")
    def _recognised(self) -> "ExportLayout":
        fits = self.fits
        if bool(fits.header) == bool(fits.cells):
            raise ValueError("expected one of fits.header and fits.cells")
        if len([kind for kind in fits.cells if kind != MORE]) != len(self.file.names):
            raise ValueError("expected as many fits.cells as file.names")
        if self.joints and not self.angle:
            raise ValueError("expected the angle (deg or rad) of joints")
        return self


@dataclass(frozen=True)
class Fitting:
    """Hold a layout that fits a file, and the place of the table in the file."""

    name: str  #: Name of the layout.
    layout: ExportLayout
    #: How the table is written; columns have names where the header alone does not say them.
    file: FileLayout
    above: tuple[str, ...] = ()  #: Lines before the table, and its comments.


@cache
def known_layouts() -> Mapping[str, ExportLayout]:
    """Read all layouts of the library's folder.

    Returns:
        The layouts by name.

    Raises:
        InputError: Names the file and the key that are wrong.
    """
    return {path.stem: _read(path) for path in sorted(FOLDER.glob("*.toml"))}


def _read(path: Path) -> ExportLayout:
    try:
        return ExportLayout.model_validate(parse_toml(path, read_text(path, MAX_BYTES)))
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        raise InputError(path, toml_place(path, keys), problem) from err


def fitting(path: Path, arm: Arm, only: str | None = None) -> Fitting | None:
    """Find the layout that fits a file.

    Args:
        path: The file, text or workbook.
        arm: The arm that was measured.
        only: Name of the layout that it must be; None for any.

    Returns:
        The layout; None where none fits.

    Raises:
        InputError: When it cannot be read, several layouts fit, or the one that was named does not.
    """
    if only is not None and only not in known_layouts():
        raise InputError(path, "", f"no layout {only!r}; layouts are {', '.join(known_layouts())}")
    fittings = every_fitting(path, arm)
    if only is not None:
        fittings = [own for own in fittings if own.name == only]
        if not fittings:
            raise InputError(path, "", f"the layout {only!r} does not fit: {_asked(known_layouts()[only])}")
    if len(fittings) > 1:
        both = " and ".join(f"{own.name} ({own.layout.title})" for own in fittings)
        raise InputError(path, "", f"fits the layouts {both}; choose one by --layout NAME")
    return fittings[0] if fittings else None


def _asked(layout: ExportLayout) -> str:
    """What a file of a layout has, in words."""
    fits = layout.fits
    if fits.header:
        wanted = f"a line with the names {', '.join(fits.header)}"
    else:
        wanted = f"rows of {len(fits.cells)} cells without a header"
    return f"expected {wanted}" + f", after {' and '.join(map(repr, fits.above))}" * bool(fits.above)


class _Row(NamedTuple):
    """A line as a row of a table."""

    line: int  #: Its place in the file, from 0.
    cells: list[str]
    names: frozenset[str]  #: Its cells as names of columns, with and without their units, squeezed.
    comment: bool  #: Whether the line is a comment.


@dataclass(frozen=True)
class _Divided:
    """The first lines of a file as rows of a table."""

    mark: str  #: Between the cells.
    rows: list[_Row]
    lines: Sequence[str]  #: All lines of the file.

    def before(self, line: int) -> tuple[str, ...]:
        """Return what stands before a line of the file, blank lines left out."""
        return tuple(self.lines[row.line] for row in self.rows if row.line < line)


def every_fitting(path: Path, arm: Arm) -> list[Fitting]:
    """Find every layout that fits a file.

    A layout whose conditions are a part of those of another one that fits is left out.

    Args:
        path: The file, text or workbook.
        arm: The arm that was measured.

    Returns:
        The layouts, each with the place of the table.

    Raises:
        InputError: When the file cannot be read.
    """
    text, how = read_letters(path, None, ".")
    lines = split_lines(path, text)
    places = [k for k, line in enumerate(lines) if line.strip(BLANK)][: SEARCHED + LOOKED_AT]
    places = [k for k in places if len(lines[k]) <= WIDEST]
    marks = ("\t",) if how.startswith(SHEET) else DELIMITERS
    divided = [_Divided(mark, [_row(lines[k], k, mark) for k in places], lines) for mark in marks]
    fittings = list[Fitting]()
    for name, layout in known_layouts().items():
        find = _with_header if layout.fits.header else _without_header
        for own in divided:
            if layout.file.delimiter in (None, own.mark) or len(divided) == 1:
                file = layout.file.model_copy(update={"delimiter": own.mark})
                if found := find(Fitting(name, layout, file), own, arm):
                    fittings.append(found)
                    break
    fits = [own.layout.fits for own in fittings]
    return [own for own in fittings if not any(_says_less(own.layout.fits, other) for other in fits)]


def _row(line: str, place: int, mark: str) -> _Row:
    cells = cells_in(line, mark)
    words = [cell for cell in cells if not is_decimal(cell)]
    names = frozenset(squeeze(own) for cell in words for own in (cell, _bare(cell)))
    return _Row(place, cells, names, is_comment(line))


def _says_less(fits: Fits, other: Fits) -> bool:
    """Whether the marks of a layout are some of another's."""
    if fits.cells and not other.cells:
        return True  # the other has found a header
    if fits.cells:
        more_cells = fits.cells[-1] == MORE != other.cells[-1]
        return more_cells or {*fits.above} < {*other.above}
    own, more = ({*one.header, *one.above} for one in (fits, other))
    return bool(fits.header and other.header) and own < more


def _without_header(fits: Fitting, divided: _Divided, arm: Arm) -> Fitting | None:
    """The table of a layout whose rows have cells of certain kinds; None where they have not."""
    above = tuple(divided.lines[row.line] for row in divided.rows if row.comment)
    rows = [row.cells for row in divided.rows if not row.comment][:LOOKED_AT]
    names = _columns_of(fits.layout, rows, len(arm.file_joints)) if _says(fits.layout, above) else []
    file = fits.file.model_copy(update={"names": names})
    return replace(fits, file=file, above=above) if names else None


def _with_header(fits: Fitting, divided: _Divided, arm: Arm) -> Fitting | None:
    """The table of a layout whose header has certain names; None where no line has them."""
    wanted = {squeeze(own) for one in fits.layout.fits.header for own in _spelled(one, arm)}
    header = next((row for row in divided.rows if wanted <= row.names), None)
    if header is None or not _says(fits.layout, above := divided.before(header.line)):
        return None
    below = next((row for row in divided.rows if row.line > header.line), header)
    if not divided.mark.strip(" ") and len(below.cells) != len(header.cells):
        return None  # blanks stand within names too
    found = replace(fits, file=fits.file.model_copy(update={"skip": header.line}), above=above)
    return _with_targets(found, header, divided, arm) if fits.layout.targets else found


def _says(layout: ExportLayout, above: Sequence[str]) -> bool:
    """Whether the lines before a table have all words that they should."""
    said = "\n".join(above).casefold()
    return all(word.casefold() in said for word in layout.fits.above)


def _bare(name: str) -> str:
    """A name without its unit."""
    return (split_unit(name) or (name,))[0]


def _spelled(name: str, arm: Arm) -> list[str]:
    """A name of a header for every joint."""
    if "{joint}" in name:
        return [name.replace("{joint}", joint.name) for joint in arm.file_joints]
    return numbered(name, len(arm.file_joints))


def numbered(name: str, count: int) -> list[str]:
    """Write a name once for every joint, with {n} replaced by its number from 1, or {n0} from 0.

    Args:
        name: The name, such as "A{n}".
        count: Number of joints.

    Returns:
        The names, `count` of them; the name alone if it has neither {n} nor {n0}.
    """
    for hole, first in (("{n}", 1), ("{n0}", 0)):
        if hole in name:
            return [name.replace(hole, str(k + first)) for k in range(count)]
    return [name]


def _columns_of(layout: ExportLayout, rows: Sequence[Sequence[str]], count: int) -> list[str]:
    """Names of the columns of a table without a header; none where its rows are not of the layout's kinds."""
    both = [
        (own, kind)
        for kind, name in zip(layout.fits.cells, layout.file.names, strict=False)
        for own in numbered(name, count)
    ]
    width = len(both)
    if layout.fits.cells[-1] == MORE:
        width = max(map(len, rows), default=0)
        both += [(f"column {k + 1}", "any") for k in range(len(both), width)]
    kinds = [kind for _, kind in both]
    return [name for name, _ in both] if rows and all(_of_kinds(cells, kinds) for cells in rows) else []


def _of_kinds(cells: Sequence[str], kinds: Sequence[str]) -> bool:
    """Whether a row has as many cells of these kinds, or more that are blank."""
    if len(cells) < len(kinds) or any(cells[len(kinds) :]):
        return False
    numbers = [number_of(cell) is not None for cell in cells]
    pairs = zip(kinds, numbers, cells, strict=False)
    return all(kind == "any" or (cell and number == (kind == "number")) for kind, number, cell in pairs)


def _with_targets(found: Fitting, header: _Row, divided: _Divided, arm: Arm) -> Fitting | None:
    """Name the columns of axes by their targets, which stand in a line above, as motion capture writes them.

    Args:
        found: The layout, and the lines before the header.
        header: The header.
        divided: The rows of the file.
        arm: The arm that was measured.

    Returns:
        The same with names as "P1 X [mm]"; None if no line says whose the axes are.
    """
    mark = divided.mark
    lines = [divided.lines[row.line] for row in divided.rows if row.line >= header.line]
    names = header.cells[: width_of(lines, mark)]
    rows = [filled_right(cells_in(line, mark), len(names)) for line in found.above]
    axes = {k: axis for k, name in enumerate(names) if (axis := _bare(name).casefold()) in XYZ}
    labels: dict[int, str] = {}
    for words in OTHERS:
        other = {k for row in rows for k, word in enumerate(row) if words.fullmatch(plain(word))}
        labels = labels or _labels(found, rows, {k: axis for k, axis in axes.items() if k not in other}, arm)
    if not labels:
        return None
    below = next((row.line for row in divided.rows if row.line > header.line), header.line)
    units = units_in(divided.lines[below], mark, len(names))
    length = stated_length_unit(found.above)
    place, own = places(arm), list(dict.fromkeys(labels.values()))
    known = all((p := place(f"{label} x")) and p.target for label in own)
    short = {label: label if known else f"M{n}" for n, label in enumerate(own, start=1)}

    turned = {k: name for k, name in enumerate(names) if name and _turned(rows, k)}
    kind = "Quaternion" if "W" in turned.values() else "Euler"
    turned = {k: f"{kind} {name}" for k, name in turned.items()}

    def called(k: int, name: str) -> str:
        if [*turned.values()].count(turned.get(k, "")) == 1:
            return turned[k]
        if k not in labels:
            return name if name and names.count(name) == 1 else f"column {k + 1} {rows[-1][k]} {name}".strip()
        unit = units[k] if units else None
        said = unit.name if unit else (parts[1].name if (parts := split_unit(name)) else length)
        return f"{short[labels[k]]} {axes[k]}" + f" [{said}]" * bool(said)

    whole = [called(k, name) for k, name in enumerate(names)]
    file = found.file.model_copy(update={"names": whole, "skip": 1 + (below if units else header.line)})
    return replace(found, file=file)


def _labels(
    found: Fitting, rows: Sequence[Sequence[str]], axes: Mapping[int, str], arm: Arm
) -> dict[int, str]:
    """The target of every column of an axis; none if no line says it."""
    word = found.layout.targets
    if word != "above":
        lines = [cells_in(line, found.file.delimiter or ",") for line in found.above]
        names = next((cells[1:] for cells in lines if cells and cells[0] == word), [])
        every = [_last(name) for name in names if name]
        columns = sorted(axes)
        alike = [axes[k] for k in columns] == [*XYZ] * len(every)
        return {k: every[n // len(XYZ)] for n, k in enumerate(columns)} if alike else {}
    markers = {plain(marker) for marker in arm.markers}
    whole = []
    for row in rows:
        labels = sorted({row[k] for k in axes} - {""})
        if sorted((row[k], axis) for k, axis in axes.items()) == [
            (own, axis) for own in labels for axis in XYZ
        ]:
            whole.append({k: _last(row[k]) for k in axes})
    return max(whole, key=lambda own: len({*map(plain, own.values())} & markers), default={})


def _turned(rows: Sequence[Sequence[str]], k: int) -> bool:
    """Whether a line above the header says that a column is of an orientation."""
    return any(plain(row[k]) == "rotation" for row in rows)


def _last(label: str) -> str:
    """The target of a label such as "Subject:P1"."""
    return label.rpartition(":")[2].strip()


def stated_length_unit(above: Sequence[str]) -> str:
    """Find the unit of length that lines above a table state, as in "Length Units,Meters".

    Args:
        above: The lines.

    Returns:
        Name of the first unit of length, such as "m"; "" if there is none.
    """
    found = (find_unit(word) for line in above for word in LENGTH.findall(line))
    return next((unit.name for unit in found if unit and unit.si == "m"), "")
