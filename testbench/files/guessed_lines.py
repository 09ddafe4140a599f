"""Gauges, and distances to fixed points, in an export of other names than ours."""

import re
from collections.abc import Iterator

from testbench.arm.folder import Arm
from testbench.files.guess import Entry
from testbench.files.guessed_loads import by_states
from testbench.files.names import (
    KNOWN_EXPORTS,
    STATE_OF_WORD,
    STATE_WORDS,
    STATES,
    XYZ,
    column_meaning,
    places,
    plain,
)
from testbench.files.rearranged import DIRECTION, SIGNED_AXIS
from testbench.files.table import TableCells

DIRECTED = "world axes, along which readings grow"


def line_entries(table: TableCells) -> Iterator[Entry]:
    """Guess the columns of gauges, or of distances to a fixed point, by their names.

    Args:
        table: The export, with what the log adds.

    Yields:
        Lines of the map; none unless a set of columns is whole.
    """
    names = {plain(name): name for name in table.names}
    letters = next((name for name in table.names if _of_directions(table, name)), "")
    for what, own in KNOWN_EXPORTS["lines"].items():
        where = "direction" if what == "travel" else "fixed"
        reading = re.compile(rf"(?:{own['reading']})?(?P<when>{STATE_WORDS})(?:{own['reading']})?")
        beside = re.compile(own["beside"])
        axes = {match["axis"]: name for text, name in names.items() if (match := beside.fullmatch(text))}
        directed = what == "travel" and (bool(letters) or {*axes} == {*XYZ})
        read = {
            STATE_OF_WORD[match["when"]]: name
            for text, name in names.items()
            if (match := reading.fullmatch(text)) and (directed or match["when"] != text)
            if column_meaning(name) not in ("mass", "state")
        }
        why = ""
        if what == "travel" and not read:
            alone = [name for text, name in names.items() if text and re.fullmatch(own["reading"], text)]
            when = "" if by_states(table) else "after"
            read = {when: alone[0]} if len(alone) == 1 else {}
            why = when and "the gauge reads zero without load"
        whole = {*read} == {*STATES} or (what == "travel" and len(read) == 1 and {*read} <= {"", "after"})
        if whole and ({*axes} == {*XYZ} or directed):
            keys = ("_".join(filter(None, (what, when))) for when in read)
            yield from (
                Entry("columns", key, name, why) for key, name in zip(keys, read.values(), strict=True)
            )
            if {*axes} == {*XYZ}:
                yield from (Entry("columns", f"{where}_{axis}", axes[axis]) for axis in XYZ)
            else:
                yield Entry("cells", letters, f"{{{DIRECTION}}}", DIRECTED)
            return


def _of_directions(table: TableCells, name: str) -> bool:
    """Whether a column holds axes of the world, such as -Z, that its name calls directions of gauges."""
    called = re.fullmatch(KNOWN_EXPORTS["lines"]["travel"]["letters"], plain(name))
    texts = {text for text in table.texts(table.names.index(name)) if text}
    return bool(called and texts) and all(map(SIGNED_AXIS.fullmatch, texts))


def gauges_in_names(table: TableCells, arm: Arm) -> list[str]:
    """Find columns of gauges whose names state a direction and perhaps a target, such as "Gauge P1 -Z [mm]".

    Args:
        table: The export.
        arm: The arm, with the names of its markers.

    Returns:
        Their names with places for these, such as "Gauge {marker} {direction} [mm]"; none if there are whole
        positions, or neither names nor rows tell that these are gauges.
    """
    place = places(arm)
    found = {*map(place, table.names)} - {None}
    if any(at and {at._replace(axis=axis) for axis in XYZ} <= found for at in found):
        return []
    markers = "|".join(map(re.escape, sorted(arm.markers, key=len, reverse=True)))
    part = re.compile(
        rf"(?<![^\W_])(?P<marker>{markers})(?![^\W_])"
        r"|(?<![^\s_(\[])(?P<direction>[+-]? ?[xyz] ?[+-]?)(?![^\s_)\]])",
        re.IGNORECASE,
    )
    reading = KNOWN_EXPORTS["lines"]["travel"]["reading"]
    wanted = re.compile(rf"(?:{reading})?(?P<when>{STATE_WORDS})?(?:{reading})?")
    patterns = dict[str, None]()
    for name in table.names:
        parts = [own.lastgroup for own in part.finditer(name)]
        rest = wanted.fullmatch(plain(part.sub(" ", name)))
        if "direction" in parts and len({*parts}) == len(parts) and rest and rest[0]:
            patterns[part.sub(lambda own: f"{{{own.lastgroup}}}", name)] = None
    return [*patterns]
