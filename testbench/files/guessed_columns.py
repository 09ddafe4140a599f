"""Joints, positions and orientations in an export, by the names of its columns."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, InputError, some_of
from testbench.files.guess import (
    MASS,
    PLACE,
    SCATTER,
    Entry,
    by_states,
    guessed_unit,
    line_entries,
    lost_words,
    mass_columns,
    mass_entries,
    not_these,
    numbers_of,
    reasons,
    refuse_twice,
    unit_of,
)
from testbench.files.layouts import Ordered, numbered
from testbench.files.names import (
    DEFLECTION,
    KNOWN_EXPORTS,
    NUMBER,
    STATE_OF_WORD,
    STATES,
    XYZ,
    Place,
    are_markers,
    column_meaning,
    joint_families,
    joint_family,
    looks_like,
    numbered_places,
    places,
    plain,
    split_unit,
)
from testbench.files.rearranged import NUMBERS, clock, numbers_in
from testbench.files.table import TableCells

POSITION = re.compile("positions?", re.IGNORECASE)
LISTED = re.compile(r"[^\W\d][\w/.-]*")  #: Name of a joint in a list such as ['joint_1', 'joint_2'].
AXES = re.compile(r"[(\[]?\bx *[/,; |] *y *[/,; |] *z\b[)\]]?", re.IGNORECASE)  #: Of a cell, as "P1 (x/y/z)".
POSED = re.compile("tcp|cart|pose|xyz|koord|coord|frame")  #: Names of cells that hold a pose of the tool.
DEVIATION = re.compile("d(elta)?[xyz]|δ[xyz]")  #: Of a deflection, or of a deviation from a drawn place.
MOVED = "every row is loaded: X is taken as unloaded, and dX as loaded minus unloaded"
COUNTED = "0 means unloaded, 1 or d means loaded, because another column names the targets"
DEVIATIONS = {f"{what}_{x}": f"sigma_{x}" for what in ("sigma", "u95") for x in XYZ}


def columns_by_name(
    table: TableCells, arm: Arm, *, length: str, angle: str, said: Collection[str]
) -> Iterator[Entry]:
    """Guess the columns of joints, positions, scatter, mass and temperature by their names, with their units.

    Args:
        table: The export, with what the log adds.
        arm: The arm.
        length: Unit of lengths that the file or its layout states; "" where they state none.
        angle: Unit of joints that turn, likewise.
        said: Quantities that a layout states; they are not guessed.

    Yields:
        Lines of the map, with the reason of each guess.

    Raises:
        InputError: When no column looks like joints or positions.
    """
    known = _by_meaning(table)
    if "joint" not in said:
        yield from _joints(table, arm, angle)
    if "reading" not in said:
        yield from _readings(table, arm, length, known)
    if "mass" not in said:
        yield from mass_entries(table)
    for theirs, our in DEVIATIONS.items() if "deviation" not in said else ():
        if theirs in known:
            k, *others = known[theirs]
            stated = unit_of(table, k)
            unit, why = guessed_unit(numbers_of(table, [k]), stated.name if stated else "", SCATTER)
            our = our if stated else f"{our}_{unit}"
            yield Entry("columns", our, table.names[k], reasons(why, not_these(table, others)))
            if theirs.startswith("u95"):
                yield Entry("scale", our, 0.5, "two standard deviations, as U95")
    if "temperature" in known and "temperature" not in said:
        k, *others = known["temperature"]
        yield Entry("columns", "temperature", table.names[k], not_these(table, others))


def _by_meaning(table: TableCells) -> dict[str, list[int]]:
    """Places of the columns of each quantity, by their names alone."""
    known = dict[str, list[int]]()
    for k, name in enumerate(table.names):
        known.setdefault(column_meaning(name), []).append(k)
    return known


def _readings(table: TableCells, arm: Arm, length: str, known: Mapping[str, list[int]]) -> Iterator[Entry]:
    """The columns of positions, of gauges or of distances; InputError where none looks like them."""
    readings, markers, stated = _positions(table, arm)
    if not readings and "axis" in known:
        readings = {"position": known["position"]} if "position" in known else _states_by_axis(table)
        if readings:
            k, *others = known["axis"]
            yield Entry("columns", "axis", table.names[k], not_these(table, others))
    if not readings:
        yield from list(line_entries(table)) or _position_cells(table, arm, length)
        return
    refuse_twice(table, [k for columns in readings.values() for k in columns])
    yield from markers
    alike = [own[0] for name, own in readings.items() if DEFLECTION not in name]
    unit, why = guessed_unit(numbers_of(table, alike), length, PLACE)
    for our, (k, *others) in readings.items():
        bare = unit_of(table, k) is None
        because = reasons(stated, why * bare, not_these(table, others))
        yield Entry("columns", our + f"_{unit}" * bare, table.names[k], because)
    yield from lost_words(table, [k for k, *_ in readings.values()])


def _states_by_axis(table: TableCells) -> dict[str, list[int]]:
    """Columns of readings unloaded and loaded, whose axis another column says; none unless both are there."""
    found = {state: k for k, name in enumerate(table.names) if (state := STATE_OF_WORD.get(plain(name), ""))}
    return {state: [k] for state, k in found.items()} if len(found) == len(STATES) else {}


def orientation_columns(table: TableCells) -> Iterator[list[Entry]]:
    """List what columns of orientations may be: three angles, or four parts of a quaternion.

    Args:
        table: The export, with what the log adds.

    Yields:
        Lines of the map, one alternative after the other: units and orders that the names leave open.
    """
    names = {plain(name): k for k, name in reversed(list(enumerate(table.names)))}
    columns, orders = next(_orientation_sets(names), ([], []))
    quaternion = len(columns) == len("wxyz")
    stated = quaternion or not columns or unit_of(table, columns[0])
    for order, unit in product(orders, [""] if stated else ["_deg", "_rad"]):
        key = "quaternion" if quaternion else "rotation"
        both = zip(order, columns, strict=True)
        yield [Entry("columns", f"{key}_{part}{unit}", table.names[k]) for part, k in both]


def _orientation_sets(names: Mapping[str, int]) -> Iterator[tuple[list[int], list[str]]]:
    """Whole sets of columns of orientations, and the orders in which their parts may be."""
    for parts, pattern in KNOWN_EXPORTS["orientations"].items():
        if found := _whole_set(names, re.compile(pattern), parts):
            yield found, [parts]
    for words in map(str.split, KNOWN_EXPORTS["together"]["orientations"]):
        found = [names[word] for word in words if word in names]
        if len(found) == len(words):
            angles = len(words) == len(XYZ)
            quaternions = ["wxyz"] if words == ["w", "i", "j", "k"] else ["wxyz", "xyzw"]
            yield (sorted(found), ["123"]) if angles else (found, quaternions)


def _whole_set(names: Mapping[str, int], pattern: re.Pattern[str], parts: str) -> list[int]:
    """Columns of names that are alike but for a part, one for each part; none where no set is whole."""
    sets = dict[str, dict[str, int]]()
    for name, k in names.items():
        if match := pattern.fullmatch(name):
            rest = f"{name[: match.start('part')]}#{name[match.end('part') :]}"
            sets.setdefault(rest, {})[match["part"]] = k
    whole = [[own[part] for part in parts] for own in sets.values() if {*own} == {*parts}]
    return min(whole, default=[])


def _joints(table: TableCells, arm: Arm, angle: str) -> Iterator[Entry]:
    """The columns of joints by their names."""
    joints, *others = joint_families(table.names, arm) or [[]]
    if joints:
        unit, why = guessed_unit(numbers_of(table, joints), angle)
        if how := _ordered(table, joints):
            yield from ordered_joints(how, table, arm, unit)
            return
        for joint, k, *alike in zip(arm.file_joints, joints, *others, strict=True):
            bare = unit_of(table, k) is None
            because = reasons(why * bare, not_these(table, alike))
            own = f"_{'m' if joint.prismatic else unit}" * bare
            yield Entry("columns", joint.name + own, table.names[k], because)
    elif arm.file_joints:
        yield _joint_cells(table, arm, angle)


def _ordered(table: TableCells, joints: Sequence[int]) -> Ordered | None:
    """Numbered columns of joints whose names stand in columns beside them, as ROS has; None without these."""
    first = table.names[joints[0]]
    *_, last = [None, *NUMBER.finditer(first)]
    if last is None:
        return None
    values = f"{first[: last.start()]}{{{'n' if int(last[0]) else 'n0'}}}{first[last.end() :]}"
    names = POSITION.sub("name", values)
    beside = names != values and {*numbered(names, len(joints))} <= {*table.names}
    return Ordered(names=names, values=values) if beside else None


def ordered_joints(how: Ordered, table: TableCells, arm: Arm, angle: str) -> list[Entry]:
    """List the joints of a table by the names that stand beside them.

    Args:
        how: Where names and values are: a column for each joint, or lists in one column.
        table: The table.
        arm: The arm; if it has other names, its joints are those of the file in their order, as a guess.
        angle: Unit of joints that turn; a slide is in m.

    Returns:
        Lines of the map.

    Raises:
        InputError: When a column of names does not say the same in all rows.
    """
    said = list[str]()
    for name in (name for name in numbered(how.names, len(table.names)) if name in table.names):
        texts = {*table.texts(table.names.index(name))}
        if len(texts) > 1:
            raise table.error(0, name, f"expected the same joints in every row, got {len(texts)} lists")
        said += LISTED.findall(min(texts))
    own, why = [joint.name for joint in arm.file_joints], ""
    if len(said) < len(own):
        raise table.header_error(
            f"expected {len(own)} joints in {how.names}, got {', '.join(said) or 'none'}"
        )
    if not {*own} <= {*said}:
        why = f"the joints {', '.join(said)} of the file are those of the arm in this order"
        said = [*own, *said[len(own) :]]
    units = {joint.name: "m" if joint.prismatic else angle for joint in arm.file_joints}
    if how.values not in table.names:
        values = dict(zip(said, numbered(how.values, len(table.names)), strict=False))
        return [Entry("columns", f"{name}_{units[name]}", values[name], why) for name in own]
    [first, *_] = table.texts(table.names.index(how.values))
    parts = iter(f"{{{name}_{units[name]}}}" if name in units else "*" for name in said)
    pattern = NUMBERS[0].sub(lambda _: next(parts, "*"), first)
    last = pattern.rfind("}") + 1  # joints beyond the arm's, as of a gripper
    return [Entry("cells", how.values, f"{pattern[:last]}*" if len(said) > len(own) else pattern, why)]


def _unlike(table: TableCells, what: str) -> InputError:
    hint = 'name it in [columns] of a map, as x = "X", or before_x and after_x of pairs'
    hint += ', or "{marker}_{when}_{axis}" = "{marker} {when} {axis}" and the words in [words]'
    if what != "a position":
        hint = (
            "if another file has the joints, add it by --log; else name all of them in [columns] of a map, "
        )
        hint += f'as "joint_{{n}}_deg" = "A{{n}}", or in [values], as {what}_deg = 0, if one never moves'
    for own in KNOWN_EXPORTS["unreadable"]:
        if any(re.fullmatch(own["names"], plain(name)) for name in table.names):
            hint = own["hint"]
    return table.header_error(f"no column looks like {what}; columns are {some_of(table.names)}; {hint}")


def _positions(table: TableCells, arm: Arm) -> tuple[dict[str, list[int]], list[Entry], str]:
    """The columns of positions by our names for them, what the map says of their targets, and why.

    Names that say a state come before those that do not, names of several targets before those of none.
    """
    found, said, why = _with_states(table, arm)
    whole = [p for p in found if p.axis == "x" and all(p._replace(axis=axis) in found for axis in XYZ)]
    stated = [p for p in whole if p.when in STATES or (p.when and p._replace(when="before") in whole)]
    whole = stated or [p for p in whole if not p.when]
    targets = list(dict.fromkeys(p.target for p in whole if p.target))
    bare = any(not p.target for p in whole)
    if bare and len(targets) < 2:
        targets = [""]
    elif bare:
        whole = [p for p in whole if p.target]
    names, markers = _names_of_targets(targets, arm)
    kept = [p._replace(axis=axis) for p in whole if p.target in targets for axis in XYZ]
    return {p.ours(names): found[p] for p in kept}, [*said, *markers], why


def _with_states(table: TableCells, arm: Arm) -> tuple[dict[Place, list[int]], list[Entry], str]:
    """The columns of positions, with states that their names do not say, what the map says of it, and why."""
    place, found = places(arm), dict[Place, list[int]]()
    by_number = numbered_places(table.names, arm)
    for k, name in enumerate(table.names):
        if at := place(name) or by_number.get(name):
            found.setdefault(at, []).append(k)
    if (hung := _by_one_load(table, place, found)) and not mass_columns(table):
        return hung
    numbers = {at.target for at in found if at.target.isdecimal() and not at.when}
    several = len(arm.markers) > 1 and _names_targets(table, arm)
    if numbers and (several or len(arm.markers) == 1):
        if counted := _counted_states(found):
            return counted, [], COUNTED
        if several:
            got = ", ".join(f"X{number}" for number in sorted(numbers))
            problem = f"expected X0 and X1, or X0 and dX, beside the column that names the targets, got {got}"
            hint = 'say which are unloaded and loaded in [columns] of a map, as before_x = "X1"'
            raise table.header_error(f"{problem}; {hint}")
    if moved := _unloaded_and_moved(table, found):
        return moved, [], MOVED
    return found, [], "the numbers stand for the axes x, y, z" if by_number else ""


def _names_of_targets(targets: Sequence[str], arm: Arm) -> tuple[dict[str, str], list[Entry]]:
    """Our names of targets by their plain names, and what the map says of those that are no markers."""
    known = {plain(marker): marker for marker in arm.markers} | {"": ""}
    if {*targets} <= {*known}:
        return known, []
    own = sorted(targets, key=lambda target: int(NUMBER.findall(target)[-1]))
    markers = [f"M{target}" if target.isdecimal() else target.upper() for target in own]
    because = "no markers of the arm"
    if len(own) == len(arm.markers):
        markers, because = list(arm.markers), "the smallest number is the arm's first marker"
    return dict(zip(own, markers, strict=True)), [Entry("series", "markers", markers, because)]


def _unloaded_and_moved(table: TableCells, found: Mapping[Place, list[int]]) -> dict[Place, list[int]]:
    """Columns X and dX as unloaded positions and deflections, if every row is loaded; else none.

    Without a load, dX may be a deviation from a drawn place, unless its name says a deflection.
    """
    moved = {at: own for at, own in found.items() if at.when == DEFLECTION}
    bare = {at._replace(when="before"): own for at, own in found.items() if not at.when}
    clear = any(not DEVIATION.search(plain(table.names[k])) for own in moved.values() for k in own)
    loaded = bool(mass_columns(table)) and not by_states(table)
    if not moved or not (loaded or clear) or any(at.when in STATES for at in found):
        return {}
    return {at: own for at, own in bare.items() if at._replace(when=DEFLECTION) in moved} | moved


def _by_one_load(
    table: TableCells, place: Callable[[str], Place | None], found: Mapping[Place, list[int]]
) -> tuple[dict[Place, list[int]], list[Entry], str] | None:
    """Columns as unloaded and loaded, if some names of positions have the same load and the others none."""
    stated = {
        at: (k, float(own["number"].replace(",", ".")), own["unit"].casefold()[:2])
        for k, name in enumerate(table.names)
        if (own := MASS.search(name)) and (at := place(MASS.sub(" ", name)))
    }
    loads = {(mass, unit) for _, mass, unit in stated.values()}
    if len(loads) != 1:
        return None
    [(mass, unit)] = loads
    both = [at for at in stated if at in found]
    columns = {at._replace(when="before"): found[at] for at in both}
    columns |= {at._replace(when="after"): [stated[at][0]] for at in both}
    why = f"{mass} {unit} in a name marks a column of loaded readings; the others are unloaded"
    return columns, [Entry("values", f"mass_{unit}", mass)], why


def _names_targets(table: TableCells, arm: Arm) -> bool:
    """Whether a column holds names of several of the arm's markers, and no other ones."""
    texts = ({*table.texts(k)} for k in range(len(table.names)))
    return any(len(own) > 1 and are_markers(own, arm) for own in texts)


def _counted_states(found: Mapping[Place, list[int]]) -> dict[Place, list[int]]:
    """Columns X0 and X1, or X0 and dX, as unloaded and loaded; none unless both are there."""
    own = {at: columns for at, columns in found.items() if at.target in ("0", "1") and not at.when}
    if {at.target for at in own} == {"0"}:
        own |= {at: columns for at, columns in found.items() if at.when == DEFLECTION and not at.target}
    states = {"0": "before", "1": "after"}
    named = {
        at._replace(target="", when=at.when or states[at.target]): columns for at, columns in own.items()
    }
    return named if len(named) == 2 * len(XYZ) else {}


def has_joints(table: TableCells, arm: Arm) -> bool:
    """Tell whether the columns of a table are those of the joints, or one holds all of them in its cells.

    Args:
        table: The table.
        arm: The arm.

    Returns:
        Whether they are.
    """
    count = len(arm.file_joints)
    return bool(joint_family(table.names, arm)) or any(
        len(_cells_of(table, k, count)) for k in range(len(table.names))
    )


def _joint_cells(table: TableCells, arm: Arm, angle: str) -> Entry:
    """The column that holds all joints in one cell; InputError where none does."""
    for k in sorted(range(len(table.names)), key=lambda k: not looks_like(table.names[k], "joints")):
        values = _cells_of(table, k, len(arm.file_joints))
        if len(values) and not POSED.search(plain(table.names[k])):
            said = unit_of(table, k)
            unit, why = guessed_unit(values, said.name if said else angle)
            slides = "_m" * any(joint.prismatic for joint in arm.file_joints)
            return Entry("cells", table.names[k], f"{{joints_{unit}{slides}}}", why)
    raise _unlike(table, arm.file_joints[0].name)


def _position_cells(table: TableCells, arm: Arm, length: str) -> Iterator[Entry]:
    """The columns that hold x, y, z in one cell, of one target or of several; InputError where none does."""
    place, found = places(arm), dict[Place, Entry]()
    markers = {plain(marker): marker for marker in arm.markers}
    for k, name in enumerate(table.names):
        if looks_like(name, "joints") or not len(values := _cells_of(table, k, len(XYZ))):
            continue
        said = unit_of(table, k)
        unit, why = guessed_unit(values, said.name if said else length, PLACE)
        bare = AXES.sub(" ", (split_unit(name) or (name,))[0])
        at = place(f"{bare} x") or Place("", "", "x")
        whose = "_".join(filter(None, (markers.get(at.target, ""), at.when, f"position_{unit}")))
        found.setdefault(at, Entry("cells", name, f"{{{whose}}}", why))
    if not found:
        raise _unlike(table, "a position")
    several = [own for at, own in found.items() if at.target in markers or at.when]
    yield from several or [*found.values()][:1]


def _cells_of(table: TableCells, k: int, count: int) -> Array:
    """Numbers of a column's cells, (cells, count), if they are neither all the same nor dates or times."""
    texts = [text for text in dict.fromkeys(table.texts(k)) if text]
    same = table.rows > 1 and len(texts) == 1
    found = None if same or clock(texts) is not None else numbers_in(texts, count)
    return np.array([[float(x.replace(",", ".")) for x in own] for own in found or []])


def require_positions(table: TableCells, arm: Arm) -> None:
    """Refuse a table without readings.

    Args:
        table: The export.
        arm: The arm, with the names of its markers.

    Raises:
        InputError: If no column looks like positions, gauges or distances.
    """
    list(_readings(table, arm, "", _by_meaning(table)))


def place_columns(table: TableCells, arm: Arm) -> list[int]:
    """Find the columns of the first position of a table.

    Args:
        table: The export, with what the log adds.
        arm: The arm, with the names of its markers.

    Returns:
        Places of x, y and z; empty if names do not tell them.
    """
    return [k for k, *_ in _positions(table, arm)[0].values()][: len(XYZ)]
