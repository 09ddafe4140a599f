"""Tables rearranged: cells of several quantities become columns, three rows of a point become one.

A robot's log is joined to a tracker's file, each reading with the row of its name or nearest time.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from testbench.arm.document import is_decimal
from testbench.errors import Array, Ids, InputError, some_of
from testbench.files.languages import FLAGS, Language, PointText, Source, known_languages, read_points
from testbench.files.mapping import HOLE, FileLayout, Log, Named, Names, without_holes
from testbench.files.names import WHOLE_NUMBER, XYZ, Slot, What, recognise, squeeze
from testbench.files.table import TableCells, read_table, table_of
from testbench.files.text import SHEET, read_letters

# --- Robot logs: a table, or a program in a known language whose joint targets become its rows --------------

OTHERS = (
    r"MAIN\s*\(\)|\.PROGRAM\b|PROGRAM\s+\w+\s*$|from\s+robo(?:dk|link)\b"
    r"|GOTO\s*/|TOOL PATH\s*/|(?:N\d+\s+)?G0?[0-3]\s*[XYZ]"
)
"""Lines of programs of other robots (Kawasaki, Comau, KAREL, RoboDK), and of machine tools (APT, G-code)."""
ROBOT = 6
"""Axes of a robot."""
ASKED = "save a table with a row for every pose: its name or time, and a column for every joint"


def read_log(path: Path, known: Callable[[str], bool], layout: FileLayout | None = None) -> TableCells:
    """Read a robot's log: a table, or a program whose joint targets become rows.

    The columns of a program are the names of its targets, axes A1 to A6, and external axes from A7 on.

    Args:
        path: The file: a table, or a program in a known robot language.
        known: Tells whether a name is that of a wanted column.
        layout: How the table is written, if that cannot be found from it.

    Returns:
        The table.

    Raises:
        InputError: If the file cannot be read, is no table, or is a program without joint targets.
    """
    text, how = read_letters(path, None, ".")
    if not how.startswith(SHEET):
        languages = known_languages().values()
        for language in languages:
            if has_line(language.text, text):
                return _read_targets(path, language)
        if has_line(OTHERS, text):
            titles = ", ".join(f"{own.title} program" for own in languages)
            problem = f"expected a table, or one of {titles}, got a program in another language; {ASKED}"
            raise InputError(path, "", problem)
    return read_table(path, known, layout)


def has_line(begins: str, text: str) -> bool:
    """Tell whether a line of a text begins with a pattern.

    Args:
        begins: The pattern.
        text: The text.

    Returns:
        Whether one does.
    """
    return re.search(rf"^[ \t]*({begins})", text, FLAGS) is not None


def _read_targets(path: Path, language: Language) -> TableCells:
    """Read the joint targets of a program: those with a name, else all in their order."""
    program, main = read_points(path, language), language.axes[:ROBOT]
    source = program.sources[0]
    point_texts = [
        point
        for point in program.points
        if not point.source and not point.posed and {*main} <= point.numbers.keys()
        if not language.pulses or point.mode != language.pulses
    ]
    point_texts = [point for point in point_texts if point.name] or point_texts
    if not point_texts:
        pulses = any(point.mode == language.pulses for point in program.points if language.pulses)
        got = "pulses, whose number per degree is unknown" if pulses else "no joint target"
        raise InputError(path, "", f"expected joints in this {language.title} program, got {got}; {ASKED}")
    names = [point.name for point in point_texts]
    if language.drop and all(name.casefold().startswith(language.drop.casefold()) for name in names):
        names = [name[len(language.drop) :] for name in names]
    names = [name and f"{language.begin}{name}" for name in names]
    outer = {axis: f"A{ROBOT + k}" for k, axis in enumerate(language.external, start=1)}
    beside = [
        axis
        for axis in outer
        if any(
            axis in point.numbers and 0 < abs(point.numbers[axis].value) < language.no_axis
            for point in point_texts
        )
    ]
    units = [f"A{k} [{language.angle}]" for k in range(1, ROBOT + 1)]
    header = [*["name"] * any(names), *units, *(outer[axis] for axis in beside)]
    rows = [
        [*[name] * any(names), *(_text(source, point, axis) for axis in (*main, *beside))]
        for name, point in zip(names, point_texts, strict=True)
    ]
    content = "\n".join("\t".join(row) for row in [header, *rows])
    table = table_of(path, (content, "utf-8"), bool, FileLayout(skip=0, delimiter="\t", decimal="."))
    lines = np.array([source.line(point.numbers[main[0]].start) for point in point_texts])
    return replace(table, lines=lines, notes=(f"{len(rows)} joint targets of a {language.title} program",))


def _text(source: Source, point: PointText, axis: str) -> str:
    """The number of an axis as it is written; "" where the point has none."""
    number = point.numbers.get(axis)
    return source.text[number.start : number.end] if number else ""


# --- Tables rearranged: cells of several quantities become columns, three rows of a point become one --------

MAX_STARS = 2  #: Wildcards in a pattern: more take long to match.
WHOLE_CELL = re.compile(
    r"\{(?:(?P<marker>\w+?)_)??(?:(?P<when>before|after)_)?(?P<what>joints|position)_(?P<unit>[a-z]+)(?:_(?P<slide>[a-z]+))?\}"
)
"""Of several numbers in a cell: their unit, and that of joints that slide."""
DIRECTION = "direction"  #: Of a cell that holds an axis of the world with its sign.
SIGNED_AXIS = re.compile(r"(?P<sign>[+-]?) ?(?P<axis>[xyz]) ?(?P<behind>[+-]?)", re.IGNORECASE)
"""An axis of the world with its sign, such as -Z or X+."""
NUMBERS = [
    re.compile(rf"(?<![\w{mark}])[-+]?(?:\d+(?:[{mark}]\d*)?|[{mark}]\d+)(?:[eE][-+]?\d+)?(?!\w)")
    for mark in (".", ",")
]
"""Numbers of a cell, by decimal mark; A1 holds none."""
WORDS = re.compile(r"[^\W\d_]+|\d+")  #: Words and numbers of a name.
LONGEST = 2_000  #: Letters of a cell whose numbers are taken apart.
EPOCH = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
"""Numbers from which times count nanoseconds, microseconds and milliseconds since 1970, and these in s."""
ROS_TIME = re.compile(r"(\d{9,10}) (\d{1,9})")  #: Seconds since 1970, and nanoseconds, of two columns.
STAMP = re.compile(r"(\d{4})(\d\d)(\d\d)[T_ ]?(\d\d)(\d\d)(\d\d)")  #: 20200714163904.
FRACTION = re.compile(
    r"(.*?:\d\d|[^.,:]*)(?:[.,](\d+))?(\s*[AP]M|\s*UTC|Z|[+-]\d\d:?\d\d)?", re.IGNORECASE | re.DOTALL
)
DAYS = ("%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%Y/%m/%d", "%d.%m.%y", "%Y年%m月%d日", "")
HOURS = ("%H:%M:%S", "%I:%M:%S %p", "%H:%M")
FORMS = ("", *(f"{day} {hour}".strip() for day in DAYS for hour in HOURS))
"""Ways of writing a time, of which the first that fits a whole column counts; "" for seconds and ISO 8601."""


def stack_columns(
    table: TableCells, patterns: Sequence[str], loads: Collection[str], markers: Collection[str]
) -> TableCells:
    """Put columns below each other that differ in nothing but a load, a target or a direction in their names.

    Args:
        table: The table.
        patterns: Names with these places, such as "X {mass_kg} [mm]" or "Gauge {marker} {direction} [mm]";
            those that no column has count only if none of them has any.
        loads: Loads in words; a load may also be a number.
        markers: Names of the targets.

    Returns:
        The table with one column per pattern, called as it without the places, and columns of what these
        say: the loads, the targets, and the components of the directions.

    Raises:
        InputError: If no pattern has columns, or those of one differ in other words than those of another, or
            have several units.
    """
    words = {"marker": {*map(squeeze, markers)}, "mass": {*map(squeeze, loads)}}
    every = {pattern: _matching(table, pattern, words) for pattern in patterns}
    stacked = {pattern: found for pattern, found in every.items() if found}
    if not stacked:
        problem = f"expected columns {patterns[0]!r} of several loads, as numbers or in [words], got none"
        raise table.header_error(problem)
    first = next(iter(stacked.values()))
    for pattern, found in stacked.items():
        if {*found} != {*first}:
            both = (", ".join(" ".join(texts) for texts in keys) for keys in (first, found))
            raise table.header_error("expected columns {!r} of {}, got {}".format(pattern, *both))
        units = {unit.name if (unit := table.units[k]) else "none" for k in found.values()}
        if len(units) > 1:
            problem = f"expected one unit of all columns {pattern!r}, got {', '.join(sorted(units))}"
            raise table.header_error(problem)
    # One cell per stacked column for each place: a load, a target, or the components of a direction.
    labels = dict[str, list[str]]()
    holes = HOLE.findall(next(iter(stacked)))
    for hole, texts in zip(holes, zip(*first, strict=True), strict=True):
        if hole == DIRECTION:
            vectors = [_direction(text) or {} for text in texts]
            labels |= {part: [vector[part] for vector in vectors] for part in vectors[0]}
        else:
            labels[hole] = [*texts]
    columns = {without_holes(pattern): [found[key] for key in first] for pattern, found in stacked.items()}
    return table.stacked(columns, labels)


def _matching(
    table: TableCells, pattern: str, words: Mapping[str, Collection[str]]
) -> dict[tuple[str, ...], int]:
    """The columns whose names fit a pattern with places, by what stands in these; of known words only."""
    literal, holes = HOLE.split(pattern)[::2], HOLE.split(pattern)[1::2]
    groups = [r"([+-]?[xyz][+-]?)" if hole == DIRECTION else "(.+?)" for hole in holes]
    parts = [re.escape(_joined(text)) for text in literal]
    inner = re.compile("".join(a + b for a, b in zip(parts, [*groups, ""], strict=True)))

    def says(hole: str, text: str) -> bool:
        if hole == DIRECTION:
            return SIGNED_AXIS.fullmatch(text) is not None
        own = hole.partition("_")[0]
        return squeeze(text) in words[own] or (own == "mass" and is_decimal(text))

    every = {
        match.groups(): k for k, name in enumerate(table.names) if (match := inner.fullmatch(_joined(name)))
    }
    return {texts: k for texts, k in every.items() if all(map(says, holes, texts))}


def _joined(text: str) -> str:
    """A name without case and blanks; hyphens stay, which may be signs."""
    return re.sub(r"[\s_]+", "", text).casefold()


def take_apart(table: TableCells, names: Names) -> tuple[TableCells, list[str]]:
    """Split cells that hold several quantities, such as "P1_loaded", into one column per quantity.

    A name that the header has twice is also known with its number, such as "X (2)", if the map uses that.

    Args:
        table: The table.
        names: Names of the quantities, with the map's patterns of such cells.

    Returns:
        The table with one more column per part, and the name under which each column is read.

    Raises:
        InputError: If a pattern is invalid, or a cell fits none of its patterns.
    """
    if names.stacked:
        table = stack_columns(table, names.stacked, names.loads, names.markers)
    read_as = _numbered(table.names, names)
    for header, patterns in names.cells.items():
        if header not in table.names:
            have = some_of(table.names)
            raise names.error(table.path, f"cells.{header}", f"no such column; columns are {have}")
        place = table.names.index(header)
        parts, divide, expected = _division(table, place, patterns, names)
        table = table.with_parts(place, parts, divide, expected)
        read_as += parts
        if not names.maps(header):
            read_as[place] = ""  # one of our names, but its parts count
    return table, read_as


Divide = Callable[[str], Mapping[str, str] | None]
"""Function that divides a cell into its parts; None for one that is written otherwise."""


def _division(
    table: TableCells, place: int, patterns: Sequence[str], names: Names
) -> tuple[list[str], Divide, str]:
    """The parts of the cells of a column, how to divide one, and how it should be written."""
    if len(patterns) == 1 and (whole := WHOLE_CELL.fullmatch(patterns[0])):
        return _numbers_apart(table, place, whole, names)
    if patterns == (f"{{{DIRECTION}}}",):
        parts = [f"{DIRECTION}_{axis}" for axis in XYZ]
        return parts, _direction, "an axis of the world with its sign, as -Z"
    for pattern in patterns:
        parts = re.findall(r"\{(\w+)\}", pattern)
        known = all(recognise(part, names.ours) for part in parts)
        if not parts or not known or len(set(parts)) < len(parts) or pattern.count("*") > MAX_STARS:
            problem = (
                "expected quantities such as {run}, {pose}, {marker}, each once, * for anything else, "
                f"got {pattern!r}"
            )
            raise names.error(table.path, f"cells.{table.names[place]}", problem)
    wholes = [*map(_expression, patterns)]

    def divide(text: str) -> Mapping[str, str] | None:
        found = (match for whole in wholes if (match := whole.fullmatch(text)))
        return next((match.groupdict() for match in found), None)

    parts = list(dict.fromkeys(part for whole in wholes for part in whole.groupindex))
    return parts, divide, f"{' or '.join(map(repr, patterns))} as in the map"


def _direction(text: str) -> dict[str, str] | None:
    """The unit vector of an axis such as -Z, blank for a blank cell; None for anything else."""
    own = SIGNED_AXIS.fullmatch(text)
    if own is None or (own["sign"] and own["behind"]):
        return None if text else {}
    number = "-1" if "-" in (own["sign"], own["behind"]) else "1"
    return {f"{DIRECTION}_{axis}": number if axis == own["axis"].casefold() else "0" for axis in XYZ}


def _numbers_apart(
    table: TableCells, place: int, pattern: re.Match[str], names: Names
) -> tuple[list[str], Divide, str]:
    """Joints, or a position, whose numbers stand in one cell with anything between them."""
    what: What = "joint" if pattern["what"] == "joints" else "reading"
    of = pattern["marker"] or "", pattern["when"] or ""
    slots = {slot.index: key for key, slot in names.ours.items() if slot == Slot(what, slot.index, *of)}
    keys = [slots[n] for n in sorted(slots) if n != WHOLE_NUMBER]
    slides = names.slides if what == "joint" else frozenset()
    units = [pattern["slide"] or "m" if n in slides else pattern["unit"] for n in range(len(keys))]
    parts = [f"{key}_{unit}" for key, unit in zip(keys, units, strict=True)]
    texts = [text for text in dict.fromkeys(table.texts(place)) if text]
    found = numbers_in(texts, len(parts)) or [[]] * len(texts)
    divided = {
        text: dict(zip(parts, own, strict=True)) for text, own in zip(texts, found, strict=True) if own
    }
    expected = f"{len(parts)} numbers in every cell, and any further numbers equal in all cells"
    return parts, divided.get, expected


def numbers_in(texts: Sequence[str], count: int) -> list[list[str]] | None:
    """Find the first numbers of every cell.

    Cells must hold equally many numbers; those after the first `count` must be the same in all cells.

    Args:
        texts: The cells.
        count: How many numbers to return per cell.

    Returns:
        The numbers as they are written, (cells, count); None unless all cells have so many.
    """
    for number in NUMBERS if all(len(text) <= LONGEST for text in texts) else ():
        found = [number.findall(text) for text in texts]
        alike = len({(len(own), *own[count:]) for own in found}) == 1
        if alike and len(found[0]) >= count:
            return [own[:count] for own in found]
    return None


def _numbered(header: tuple[str, ...], names: Names) -> list[str]:
    """The names of a header; those that stand there again with their number, where the map has it."""
    count, found = Counter[str](), list[str]()
    for name in header:
        count[name] += 1
        numbered = f"{name} ({count[name]})"
        found.append(numbered if count[name] > 1 and names.maps(numbered) else name)
    return found


def _expression(pattern: str) -> re.Pattern[str]:
    """A pattern as a regular expression: {part} is as short as may be, * anything."""
    pieces = re.split(r"\{(\w+)\}", pattern)
    literal = [re.escape(piece).replace(r"\*", ".*") for piece in pieces[::2]]
    literal = [re.sub(r"(\\ )+", r"\\s+", own) for own in literal]  # blanks, however many
    groups = [f"(?P<{part}>.+?)" for part in pieces[1::2]]
    return re.compile("".join(a + b for a, b in zip(literal, [*groups, ""], strict=True)), re.IGNORECASE)


def join_axes(
    table: TableCells, named: dict[int, Named], names: Names
) -> tuple[TableCells, dict[int, Named]]:
    """Join the three rows of a point to one row, if a column states the axis of each row.

    Args:
        table: The table.
        named: Meaning of its columns, by place.
        names: Names of the quantities.

    Returns:
        The table and the meaning of its columns; both unchanged if no column states an axis.

    Raises:
        InputError: If the three rows of a point are not adjacent, or differ in what they share.
    """
    axis = next((k for k, own in named.items() if own.slot.what == "axis"), None)
    whole = [k for k, own in named.items() if own.slot.index == WHOLE_NUMBER]
    if axis is None or not whole:
        for k in whole:
            if named[k].mapped:
                problem = f"expected an axis in the name {named[k].mapped!r}, or a column of axes, 'axis'"
                raise names.error(table.path, f"columns.{named[k].mapped}", problem)
        return table, {k: own for k, own in named.items() if k not in (axis, *whole)}
    # Drop rows of ignored axes, and sort the three rows of each point.
    other = [squeeze(text) in names.ignored for text in table.texts(axis)]
    table = table.take(~np.array(other, dtype=bool))
    rows = _rows_of_points(table, axis)
    kept = [k for k in range(len(table.names)) if k != axis and k not in whole]
    _check_shared(table, [k for k in kept if k in named])
    # The first row of each point, with one column per axis.
    points, spread = table.take(np.arange(table.rows) % 3 == 0), [(k, i) for k in whole for i in range(3)]
    points = replace(
        points,
        names=(*(table.names[k] for k in kept), *(f"{XYZ[i]} {table.names[k]}" for k, i in spread)),
        units=tuple(table.units[k] for k in (*kept, *(k for k, _ in spread))),
        cells=[points.cells[k] for k in kept] + [table.cells[k].take(rows[:, i]) for k, i in spread],
    )
    found = {n: named[k] for n, k in enumerate(kept) if k in named}
    for n, (k, i) in enumerate(spread, start=len(kept)):
        found[n] = replace(named[k], slot=replace(named[k].slot, index=i))
    return points, found


def _rows_of_points(table: TableCells, axis: int) -> Ids:
    """Rows of x, y and z of every point, (points, 3)."""
    texts = [squeeze(text) for text in table.texts(axis)]
    for row, text in enumerate(texts):
        if text not in XYZ:
            got = table.texts(axis)[row][:80]
            problem = f"no axis {got!r}; axes are {', '.join(XYZ)}; [words] of a map can ignore others"
            raise table.error(row, table.names[axis], problem)
    for row in range(0, len(texts), 3):
        if sorted(texts[row : row + 3]) != list(XYZ):
            problem = "expected the rows x, y, z of a point together, one each"
            raise table.error(row, table.names[axis], problem)
    order = np.array([XYZ.index(text) for text in texts], dtype=int).reshape(-1, 3)
    return np.argsort(order, axis=1) + 3 * np.arange(len(order))[:, None]


def _check_shared(table: TableCells, columns: list[int]) -> None:
    """Check that conditions of a point are equal in its three rows, or blank in the lower ones."""
    for k in columns:
        texts = table.texts(k)
        for row, text in enumerate(texts):
            first = texts[row - row % 3]
            if text not in (first, ""):
                problem = f"expected {first[:80]!r} as in the other rows of the point, got {text[:80]!r}"
                raise table.error(row, table.names[k], problem)


def clock(texts: Sequence[str]) -> Array | None:
    """Convert dates and times, or times of a day, in one notation to seconds.

    Args:
        texts: The cells, n of them.

    Returns:
        Times, (n,) [s], from a start that depends on the notation; None if a cell is no time.
    """
    if texts and all(is_decimal(text) and not STAMP.fullmatch(text) for text in texts):
        values = np.array([float(text) for text in texts])
        return values * next((unit for most, unit in EPOCH if values.max() > most), 1.0)
    split = [part for text in texts if (part := ROS_TIME.fullmatch(text))]
    if split and len(split) == len(texts):
        return np.array([float(part[1]) + 1e-9 * float(part[2]) for part in split])
    parts = [part for text in texts if (part := FRACTION.fullmatch(text))]
    for form in FORMS if parts and len(parts) == len(texts) else ():
        zones = [(part[3] or "").upper().replace(" UTC", "Z") for part in parts]
        found = [_seconds(form, f"{part[1]}{zone}") for part, zone in zip(parts, zones, strict=True)]
        if None not in found:
            beyond = np.array([float(f"0.{part[2] or 0}") for part in parts])
            return np.asarray(np.array(found, dtype=float) + beyond)
    return None


def _seconds(form: str, text: str) -> float | None:
    if not form:
        return float(text) if is_decimal(text) and not STAMP.fullmatch(text) else seconds(text)
    try:
        return datetime.strptime(text, form).replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None


def seconds(text: str) -> float | None:
    """Convert a date and time to seconds since 1970.

    Args:
        text: The date and time; UTC if it states no zone.

    Returns:
        The time [s]; None if the text is no date and time.
    """
    stamp = STAMP.fullmatch(text)
    try:
        when = datetime.fromisoformat("{}-{}-{}T{}:{}:{}".format(*stamp.groups()) if stamp else text)
    except ValueError:
        return None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def with_loaded(table: TableCells, loaded: TableCells) -> TableCells:
    """Put loaded readings of another file or sheet below the unloaded ones.

    Args:
        table: The unloaded readings.
        loaded: The loaded ones; their columns have the same names and units.

    Returns:
        Both, with a column `state`.

    Raises:
        InputError: If the columns are not the same.
    """
    return table.above([loaded], "state", ("unloaded", "loaded"))


def with_log(table: TableCells, names: Names) -> TableCells:
    """Join the columns of the log that a map names; points that the map ignores have no row in the log.

    Args:
        table: The table of readings.
        names: Names of the quantities, with the map.

    Returns:
        The joined table; the table itself if the map names no log.

    Raises:
        InputError: As `join_log`, and if the log cannot be read.
    """
    if names.map.log is None:
        return table
    for k, named in enumerate(map(names.find, table.names)):
        if named and named.slot == Slot("marker"):
            table = table.take(np.array([squeeze(text) not in names.ignored for text in table.texts(k)]))
    file = (names.path or table.path).parent / names.map.log.file
    return join_log(table, read_log(file, names.knows, names.map.log.table), names.map.log)


def join_log(table: TableCells, log: TableCells, how: Log) -> TableCells:
    """Join the columns of a log that a table of readings lacks, by row, by name or by nearest time.

    Args:
        table: The table of readings.
        log: The table of the log.
        how: How their rows correspond.

    Returns:
        The joined table.

    Raises:
        InputError: At the first reading without a row of the log, or at a name that the log has twice.
    """
    to = how.to or how.on
    if how.rows is not None:
        return _row_by_row(table, log, how.rows)
    if how.within_s is None:
        match = _by_part if how.parts else _by_name
        return table.with_columns_of(log, match(table, log, keys_of(table, how.on), keys_of(log, to)))
    ours, theirs = times_of(table, how.on), times_of(log, to)
    rows = nearest_times(ours, theirs)
    apart, most = np.abs(theirs[rows] - ours), f"expected a row of {log.path.name} within {how.within_s:g} s"
    table.refuse(apart > how.within_s, "", lambda row: f"{most}, the nearest is {apart[row]:.4g} s away")
    return table.with_columns_of(log, rows)


def _row_by_row(table: TableCells, log: TableCells, count: int) -> TableCells:
    """So many rows of a table in turn with one of the log; InputError where the counts do not agree."""
    if table.rows != count * log.rows:
        expected = (
            f"{count} rows for each of {log.rows} rows of {log.path.name}"
            if count > 1
            else f"{log.rows} rows"
        )
        raise table.error(0, "", f"expected {expected} to join row by row, got {table.rows}")
    return table.with_columns_of(log, np.arange(table.rows) // count)


def nearest_times(ours: Array, theirs: Array) -> Ids:
    """Find the nearest of other times for every time.

    Args:
        ours: Times, (rows,) [s].
        theirs: Other times, (k,) [s].

    Returns:
        Places among the others, (rows,).
    """
    return np.array([int(np.abs(theirs - t).argmin()) for t in ours], dtype=np.int64)


def times_of(table: TableCells, columns: Sequence[str]) -> Array:
    """Read times from the text that some columns form together.

    Args:
        table: The table.
        columns: Names of the columns, such as a date and a time of day.

    Returns:
        Times, (rows,) [s]; their zero depends on the notation.

    Raises:
        InputError: If the text is in no known notation of times.
    """
    found = clock(keys_of(table, columns)) if columns else None
    if found is None:
        raise table.header_error(f"expected times to join by in {' and '.join(columns) or 'a column'}")
    return found


def keys_of(table: TableCells, columns: Sequence[str]) -> list[str]:
    """Read the text that some columns form together, row by row.

    Args:
        table: The table.
        columns: Names of the columns.

    Returns:
        One text per row, its parts separated by blanks.

    Raises:
        InputError: If a column is missing.
    """
    if missing := [name for name in columns if name not in table.names]:
        raise table.header_error(f"no column {missing[0]!r} to join by; columns are {some_of(table.names)}")
    return [" ".join(own) for own in zip(*(table.texts(table.names.index(n)) for n in columns), strict=True)]


def _by_part(table: TableCells, log: TableCells, keys: list[str], theirs: list[str]) -> Ids:
    rows = parts_in(keys, theirs)
    problem = f"expected one name of {log.path.name} in this cell, got {{!r}}"
    table.refuse(rows < 0, "", lambda row: problem.format(keys[row][:80]))
    return rows


def parts_in(texts: Sequence[str], parts: Sequence[str]) -> Ids:
    """Find the one of some names that is a part of each text, such as P1 of "A::P01_unloaded::T2".

    Names are compared word by word, numbers by value. Of several names the one of most words counts.

    Args:
        texts: The texts, n of them.
        parts: The names, each once.

    Returns:
        Place of the name, (n,); -1 for a text with none, or with several.
    """
    place = {_words(part): k for k, part in enumerate(parts)}
    found = {text: _longest(_words(text), place) for text in dict.fromkeys(texts)}
    return np.array([found[text] for text in texts], dtype=np.int64)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.lstrip("0") or "0" for word in WORDS.findall(text.casefold()))


def _longest(words: tuple[str, ...], place: Mapping[tuple[str, ...], int]) -> int:
    for count in range(len(words), 0, -1):
        runs = {words[k : k + count] for k in range(len(words) - count + 1)}
        if own := [place[run] for run in runs if run in place]:
            return own[0] if len(own) == 1 else -1
    return -1


def _by_name(table: TableCells, log: TableCells, keys: list[str], theirs: list[str]) -> Ids:
    place: dict[str, int] = {}
    for row, key in enumerate(map(squeeze, theirs)):
        if place.setdefault(key, row) != row:
            raise log.error(row, "", f"expected every name once, got {theirs[row][:80]!r} again")
    rows = np.array([place.get(squeeze(key), -1) for key in keys], dtype=np.int64)
    table.refuse(rows < 0, "", lambda row: f"no row of {log.path.name} is called {keys[row][:80]!r}")
    return rows
