"""A map: how somebody's export names our quantities, as TOML of a few lines."""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from testbench.arm.document import (
    StrictModel,
    first_invalid_value,
    is_decimal,
    parse_toml,
    text_matching,
    toml_place,
)
from testbench.arm.folder import Arm
from testbench.errors import InputError, read_text
from testbench.files.names import (
    STATES,
    Slot,
    Unit,
    expand,
    our_names,
    placeholders,
    recognise,
    series_names,
    split_unit,
    squeeze,
)

MAX_BYTES = 20_000
CONSTANTS = ("joint", "mass", "force", "moment", "point", "sigma", "tilt", "fixed_sigma", "zero_sigma")
"""Quantities that may be one number for the whole file."""
PLACES = "put names of columns below [columns], and a number that holds for the whole file below [values]"
IGNORE, LOST = "ignore", "lost"  #: Keys of the words for points that are no markers, and for lost targets.

Text = Annotated[str, Field(min_length=1, max_length=200)]
Frame = Literal["base", "tracker"]
Encoding = Literal[
    "utf-8", "utf-16-le", "utf-16-be", "cp1252", "cp1250", "cp1251", "latin-1", "cp932", "cp949", "gb18030"
]


def _listed(given: object) -> object:
    """Make a text that stands alone a list of one."""
    return [given] if isinstance(given, str) else given


Notation = Annotated[
    str,
    text_matching(
        "vector|(intrinsic|extrinsic) [xyz]{3}",
        '"vector", "intrinsic xyz" or "extrinsic xyz" with the axes in their order',
    ),
]  #: Of three angles.
Texts = Annotated[list[Text], BeforeValidator(_listed)]
Cells = Annotated[list[Annotated[str, Field(max_length=200)]], BeforeValidator(_listed)]
"""Texts of cells, which may be blank."""
Words = tuple[str, ...]


class FileLayout(StrictModel):
    """Describe the layout of a file, as far as it cannot be found from the file itself."""

    #: Between cells; " " for runs of blanks, "  " for runs of at least two.
    delimiter: Literal[",", ";", "\t", "|", " ", "  "] | None = None
    decimal: Literal[".", ","] | None = None  #: The decimal mark.
    #: How its bytes are letters.
    encoding: Encoding | None = None
    skip: int | None = Field(default=None, ge=0, le=10_000)  #: Lines before the header.
    footer: int = Field(default=0, ge=0, le=10_000)  #: Lines behind the table.
    names: list[Text] = Field(default=[], max_length=1000)  #: Of the columns, where the file has no header.
    header: int = Field(default=1, ge=1, le=3)  #: Lines of the header; the upper ones may be of merged cells.
    transposed: bool = False  #: Whether a row of the file is a column, and each of its columns a row.
    merged: bool = False  #: Whether a blank cell takes the value above, as below merged cells.
    #: Whether lines of words name the rows below them, as "Loaded"; they become the column `section`.
    sections: bool = False
    average: bool = False  #: Whether rows of one point are shots, of which the mean is its reading.
    #: Columns of the name, the value and (optional) the unit of a quantity, if each row holds one quantity.
    tidy: list[Text] = Field(default=[], max_length=3)
    #: Sheets of one workbook below each other; their names become the column `sheet`.
    sheets: list[Text] = Field(default=[], max_length=100)

    @model_validator(mode="after")
    def _named_and_valued(self) -> "FileLayout":
        if len(self.tidy) == 1:
            raise ValueError('expected tidy = ["name", "value"] or ["name", "value", "unit"]')
        return self


class AbsoluteLayout(StrictModel):
    """Describe the absolute readings of a file; names that are not stated are the file's own."""

    frame: Text | None = None  #: Name of the tracker's frame; files that say the same share it.
    target: Text | None = None  #: Name of the mount of the targets; the same.
    markers: list[Text] = Field(default=[], max_length=100)  #: Targets where they are not the arm's.
    #: What three angles are: a rotation vector, or Euler angles in their order.
    rotation: Notation | None = None


class Log(StrictModel):
    """Describe another file with a row for every reading, such as the robot's joints."""

    file: Text  #: Its path from the map's folder.
    on: list[Text] = Field(default=[])  #: Columns of the readings that say together a row's name or time.
    to: list[Text] = Field(default=[])  #: Those of the log, where they are called otherwise.
    parts: bool = False  #: Whether the log's names are parts of the names here, as P1 of "P01 unloaded".
    #: By the nearest time, at most so far away [s]; by name where it is not said.
    within_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    #: Where nothing says which row belongs to which: how many readings in a row belong to one of the log.
    rows: int | None = Field(default=None, ge=1, le=1000)
    table: FileLayout = FileLayout()  #: How that file is written.

    @model_validator(mode="after")
    def _keyed(self) -> "Log":
        if bool(self.on) == (self.rows is not None):
            raise ValueError("expected `on` (columns to join by) or `rows` (readings per row of the log)")
        return self


class LoadedFile(StrictModel):
    """Describe another file, or sheet, of the same columns: its readings are loaded, those here unloaded."""

    file: Text  #: Its path from the map's folder.


class Controller(StrictModel):
    """Describe what a robot's program counts by, as far as its language does not say it."""

    #: The program's base in the arm's world, as the language writes a pose; empty for the world itself.
    base: list[float] = Field(default=[], max_length=7)
    #: The program's tool in the arm's tool, as the language writes a pose; empty for the arm's tool.
    tool: list[float] = Field(default=[], max_length=7)
    #: Pulses of every motor per degree of its joint, where the program counts pulses.
    pulses_per_deg: list[Annotated[float, Field(gt=-1e9, lt=1e9)]] = Field(default=[], max_length=12)

    @model_validator(mode="after")
    def _turns(self) -> "Controller":
        if 0 in self.pulses_per_deg:
            raise ValueError("expected pulses_per_deg other than 0")
        return self


class Map(StrictModel):
    """Hold a map as its file states it."""

    frame: Frame | None = None
    file: FileLayout = FileLayout()
    series: AbsoluteLayout = AbsoluteLayout()
    log: Log | None = None
    loaded: LoadedFile | None = None
    controller: Controller = Controller()
    columns: dict[Text, Texts] = Field(default_factory=dict, max_length=200)
    optional: dict[Text, Texts] = Field(default_factory=dict, max_length=200)
    cells: dict[Text, Texts] = Field(default_factory=dict, max_length=20)
    words: dict[Text, Cells] = Field(default_factory=dict, max_length=200)
    values: dict[Text, float] = Field(default_factory=dict, max_length=50)
    scale: dict[Text, Annotated[float, Field(gt=0, lt=1e6)]] = Field(default_factory=dict, max_length=50)


HOLE = re.compile(r"\{(mass_[a-z]+|marker|direction)\}")
"""In place of what only the name of a column states: a load, or target and direction of a gauge."""


def without_holes(name: str) -> str:
    """Remove the places of a load, a target and a direction from a name.

    Args:
        name: The name of columns that differ in nothing else, such as "X {mass_kg} [mm]".

    Returns:
        The name without them, such as "X [mm]".
    """
    return " ".join(HOLE.sub(" ", name).split())


@dataclass(frozen=True)
class Named:
    """Describe the meaning of a column of a user's file."""

    slot: Slot  #: The quantity.
    unit: Unit | None  #: Its unit by our name for it; None where that has none.
    sign: float = 1.0  #: What the cells are multiplied by: -1 where the map has a minus before the name.
    mapped: str = ""  #: Key of the map that says so; empty for one of our own names.
    optional: bool = False  #: Whether the file may lack the column.
    header: Unit | None = None  #: Its unit by what the file calls it, beside a map.


@dataclass(frozen=True)
class Names:
    """Hold all names that a file may use: ours, and those of its map."""

    path: Path | None  #: The map, for messages; None without one.
    ours: Mapping[str, Slot]  #: Our own, squeezed.
    theirs: Mapping[str, Named]  #: Those of the map, squeezed.
    words: Mapping[str, str]  #: What cells say for our markers and states, squeezed.
    ignored: frozenset[str]  #: Squeezed names of points that are no markers.
    values: Mapping[Slot, tuple[float, Unit]]  #: Constants and their units.
    cells: Mapping[str, tuple[str, ...]]  #: Patterns of what cells hold together, by their column.
    stacked: tuple[str, ...]  #: Names of columns with places of a load, a target or a direction in them.
    lost: Mapping[str, str]  #: What stands for a lost target: a blank.
    loads: Mapping[str, str]  #: Words for masses and forces, and their numbers.
    markers: tuple[str, ...]  #: Names of the targets that the file may have.
    slides: frozenset[int]  #: Which joints slide, counted from 0.
    map: Map  #: What the map says beside names.
    load: float | None = None  #: Mass that hangs in loaded rows where nothing says one [kg].

    def find(self, header: str) -> Named | None:
        """Find the meaning of a column; the map has priority over our own names.

        Args:
            header: Name of the column in the file.

        Returns:
            The meaning; None if the name is unknown.
        """
        if named := self.theirs.get(squeeze(header)):
            parts = split_unit(header, brackets=True)
            return replace(named, header=parts[1]) if parts else named
        if (parts := split_unit(header)) and (named := self.theirs.get(squeeze(parts[0]))):
            return replace(named, header=parts[1])
        own = recognise(header, self.ours)
        return None if own is None else Named(*own)

    def knows(self, header: str) -> bool:
        """Tell whether a column with that name is read.

        Args:
            header: Name of the column in the file.

        Returns:
            Whether its meaning is known, or the map divides its cells.
        """
        return self.find(header) is not None or header in self.cells

    def maps(self, header: str) -> bool:
        """Tell whether the map has a column with that name.

        Args:
            header: Name of the column in the file, with or without its unit.

        Returns:
            Whether it has.
        """
        parts = split_unit(header)
        return any(squeeze(text) in self.theirs for text in [header, *([parts[0]] if parts else [])])

    def error(self, file: Path, place: str, problem: str) -> InputError:
        """Make the error about an entry of the map; without a map it names the file that is read.

        Args:
            file: The file that is read.
            place: Key of the map.
            problem: Expected and actual value.

        Returns:
            The error.
        """
        return InputError(self.path or file, place, problem)

    def word(self, text: str, known: Collection[str]) -> str:
        """Translate the text of a cell into our word for it.

        Args:
            text: The cell.
            known: Our words that may stand in this column.

        Returns:
            The word; "" if the text means none of them.
        """
        ours = text if text in known else self.words.get(squeeze(text), "")
        return ours if ours in known else ""


def read_map(
    path: Path | Map | None, arm: Arm, quantities: Callable[[Arm], dict[str, Slot]] = our_names
) -> Names:
    """Read a map, and combine it with our names for an arm.

    Args:
        path: The map, or its file; None for none.
        arm: The arm.
        quantities: Function that lists our names: those of runs, absolute readings or programs. The map may
            name other targets than the arm's, except for runs.

    Returns:
        All names that a file may use.

    Raises:
        InputError: Names the key and what was expected.
    """
    found = _read(path) if isinstance(path, Path) else path or Map()
    path = path if isinstance(path, Path) else None
    if found.series.markers and quantities is not our_names:
        arm = replace(arm, markers=tuple(found.series.markers))
    ours = quantities(arm)
    others = series_names(arm) if quantities is our_names else {}  # one map reads a file either way
    where = path or Path()
    words, ignored, lost_words = _words(where, found, arm)
    choices = placeholders(arm, words)
    said = {name: (name,) for name in arm.markers} | STATES
    if unknown := [key for key in found.scale if key not in {**found.columns, **found.optional}]:
        keys = ", ".join({**found.columns, **found.optional}) or "none"
        raise InputError(
            where, f"scale.{unknown[0]}", f"expected a key of columns or optional, which are {keys}"
        )
    theirs, stacked = _columns(where, found, ours, others, choices)
    return Names(
        path=path,
        ours=ours,
        theirs=theirs,
        words={squeeze(word): key for key, own in said.items() for word in (*own, *words.get(key, ()))},
        ignored=frozenset(map(squeeze, ignored)),
        values=_values(where, found, ours),
        cells={header: tuple(patterns) for header, patterns in found.cells.items()},
        stacked=stacked,
        lost=dict.fromkeys(lost_words, ""),
        loads={word: key for key, own in words.items() if is_decimal(key) for word in own},
        markers=arm.markers,
        slides=frozenset(k for k, joint in enumerate(arm.file_joints) if joint.prismatic),
        map=found,
    )


def _read(path: Path) -> Map:
    data = parse_toml(path, read_text(path, MAX_BYTES))
    try:
        return Map.model_validate(data)
    except ValidationError as err:
        keys, kind, problem = first_invalid_value(err)
        if kind == "extra_forbidden":
            tables: dict[str, type[StrictModel]] = {
                "series": AbsoluteLayout,
                "log": Log,
                "loaded": LoadedFile,
                "controller": Controller,
            }
            inner = FileLayout if "table" in keys[:-1] else tables.get(str(keys[0]), FileLayout)
            known = Map.model_fields if len(keys) == 1 else inner.model_fields
            problem = f"unknown key; keys are {', '.join(known)}"
            problem += f"; {PLACES}" * (len(keys) == 1)
        if keys[0] in ("columns", "optional") and kind in ("list_type", "string_type"):
            got = problem.partition(", got ")[2]
            problem = f"expected the name of a column in quotation marks, got {got}; {PLACES}"
        raise InputError(path, toml_place(path, keys), problem) from err


def _words(path: Path, found: Map, arm: Arm) -> tuple[dict[str, Words], Words, Words]:
    known = [*STATES, *arm.markers, IGNORE, LOST]
    for key in found.words:
        if key not in known and not is_decimal(key):
            raise InputError(path, f"words.{key}", f"expected one of {', '.join(known)}, or a load as 150.0")
    words = {key: tuple(value) for key, value in found.words.items()}
    if blank := [key for key, own in words.items() if "" in own and key != LOST]:
        raise InputError(
            path, f"words.{blank[0]}", "expected words, got ''; a blank cell can only mean `lost`"
        )
    return words, words.pop(IGNORE, ()), words.pop(LOST, ())


def _unknown(our: str, their: str, name: str, choices: Mapping[str, list[tuple[str, Words]]]) -> str:
    """Say what was expected in place of a pair of names."""
    if "{" in their:
        return f"expected the same {{...}} in both names, got {name!r}"
    joints = ", ".join(joint for joint, _ in choices["joint"]) or "none"
    return f"unknown quantity {our!r}; expected one of testbench with its unit; joints are {joints}"


def _columns(
    path: Path,
    found: Map,
    ours: Mapping[str, Slot],
    others: Mapping[str, Slot],
    choices: Mapping[str, list[tuple[str, Words]]],
) -> tuple[dict[str, Named], tuple[str, ...]]:
    """The columns that a map names, but for those of other quantities, which this kind of file has not.

    Returns:
        Their meanings, by squeezed name; and the names with a place of a load, a target or a direction.
    """
    named: dict[str, Named] = {}
    alone: set[Slot] = set()
    stacked = dict[str, None]()
    both = [(key, names, "columns") for key, names in found.columns.items()]
    both += [(key, names, "optional") for key, names in found.optional.items()]
    for key, names, section in sorted(both, key=lambda item: "{" in item[0]):  # patterns say less
        place = f"{section}.{key}"
        for name in names:
            sign, plain = (-1.0, name[1:]) if name.startswith("-") else (1.0, name)
            for our, their in expand(key, plain, choices):
                known = recognise(our, ours)
                if _has_holes(path, place, known, their):
                    stacked[their] = None
                    their = without_holes(their)
                if known is None and "{" not in their and recognise(our, others):
                    continue
                if known is None or "{" in their:
                    raise InputError(path, place, _unknown(our, their, name, choices))
                if "{" in key and known[0] in alone:
                    continue
                times = sign * found.scale.get(key, 1.0)
                new = Named(*known, times, key, optional=section == "optional")
                if "{" not in key:
                    alone.add(known[0])
                if named.setdefault(squeeze(their), new) != new:
                    raise InputError(path, place, f"the name {their!r} stands for two quantities")
    return named, tuple(stacked)


def _has_holes(path: Path, place: str, known: tuple[Slot, Unit | None] | None, name: str) -> bool:
    """Whether a name has places of a load, a target or a direction; these two are for gauges alone."""
    holes = HOLE.findall(name)
    of_gauge = known is not None and known[0].what == "travel"
    if not holes or not (of_gauge or {*holes}.isdisjoint({"marker", "direction"})):
        return False
    if place.startswith("optional"):
        raise InputError(path, place, "the placeholder of a load is allowed only in [columns]")
    if len({*holes}) < len(holes) or sum(hole.startswith("mass_") for hole in holes) > 1:
        problem = f"expected each placeholder of a load, a target or a direction once, got {name!r}"
        raise InputError(path, place, problem)
    return True


def _values(path: Path, found: Map, ours: Mapping[str, Slot]) -> dict[Slot, tuple[float, Unit]]:
    values = {}
    for key, value in found.values.items():
        known = recognise(key, ours)
        if known is None or known[1] is None or known[0].what not in CONSTANTS:
            kinds = ", ".join(CONSTANTS)
            raise InputError(
                path, f"values.{key}", f"expected one of {kinds} with its unit, as sigma_um or mass_kg"
            )
        slot, unit = known[0], known[1]
        if slot.what == "sigma":
            slot = replace(slot, index=int(unit.si == "rad"))
        values[slot] = value, unit
    return values
