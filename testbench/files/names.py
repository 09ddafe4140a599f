"""The quantities of a measurement, the names that our files give them, and units in the names of columns.

Loads in words: masses such as "460.3 kg" or "2 x 20 kg + 5 kg", and codes that a legend explains.
"""

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from pathlib import Path
from typing import Literal, NamedTuple

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.errors import some_of

# --- The quantities of a measurement ------------------------------------------------------------------------

KNOWN_EXPORTS = tomllib.loads(Path(__file__).with_name("exports.toml").read_text(encoding="utf-8"))
"""How exports call quantities, units and states, in ten languages."""


@dataclass(frozen=True)
class Unit:
    """Describe a unit in a file."""

    name: str  #: As we write it.
    si: str  #: What it is a multiple of.
    scale: float  #: How many of that it is.


INCH, POUND, STANDARD = 0.0254, 0.45359237, 9.80665
"""Of the inch [m], the pound [kg] and the acceleration that makes its force [m/s^2], exact by definition."""
DEGREE = math.pi / 180  #: Of a radian.
GON, GRAD = Unit("gon", "rad", math.pi / 200), Unit("grad", "rad", DEGREE)
"""GRAD is degrees in German, Spanish and Russian, and gon in English: `find_columns` settles it."""
SCALES = {
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": INCH, "mil": 1e-3 * INCH, "ft": 12 * INCH},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "mdeg": 1e-3 * DEGREE, "gon": GON.scale}
    | {"arcmin": DEGREE / 60, "arcsec": DEGREE / 3600, "rev": 2 * math.pi},
    "N": {"N": 1.0, "daN": 10.0, "kN": 1e3, "lbf": POUND * STANDARD, "kgf": STANDARD},
    "Nm": {"Nm": 1.0, "Nmm": 1e-3},
    "kg": {"kg": 1.0, "lb": POUND, "g": 1e-3, "t": 1e3},
    "m2": {"m2": 1.0, "mm2": 1e-6, "um2": 1e-12},
}
"""Units that are read, by what they are multiples of."""
UNITS = tuple(Unit(name, si, scale) for si, own in SCALES.items() for name, scale in own.items())
#: Of what is not zero, in any unit: its square is not zero, nor what is divided by it infinite.
MIN_NUMBER = 1e-100
MAX_NUMBERS = {"m": 1e6, "rad": 1e6, "N": 1e9, "Nm": 1e9, "kg": 1e6, "m2": 1e6}
"""Largest number of a quantity in SI that is read: beyond it a file is broken."""
OTHER_NAMES = {other: unit for unit, words in KNOWN_EXPORTS["units"].items() for other in words.split()}
"""What files write for these, in small letters; both micro signs become the Greek letter."""
UNITS_BY_NAME = {unit.name.lower(): unit for unit in (*UNITS, GRAD)}
PART = re.compile(r"(?P<under>1/)?(?P<number>\d+([.,]\d+)?)(?P<unit>[^\W\d]+)")
"""A part of a unit that an instrument counts by, such as 0.01 mm or 1/100 mm."""
LETTERS = ("g", "t")
"""Units of a letter that is more often a name: without brackets they count behind a mass only, as load_t."""
MAX_NAME_LENGTH = 200  #: Letters of the longest name that may end with a unit.
BRACKETS = re.compile(r"^(.*?)\s*[\[(]\s*([^\[\]()]+?)\s*[\])]$")
TAIL = re.compile(r"^(.*?)(?:\s*[/,]\s*|\s+(?i:in)\s+|[\s_]+)([^\s_/,\[\]()]+)$")


def find_unit(word: str) -> Unit | None:
    """Find the unit of a word, whatever its case and its blanks.

    Args:
        word: The word, such as "mm".

    Returns:
        The unit; None for any other word.
    """
    small = "".join(word.casefold().split()).replace("²", "2").removesuffix(".")
    if part := PART.fullmatch(small):
        unit, number = find_unit(part["unit"]), float(part["number"].replace(",", "."))
        if unit is None or unit.si != "m" or not number:
            return None
        return Unit(word, "m", unit.scale / number if part["under"] else unit.scale * number)
    return UNITS_BY_NAME.get(OTHER_NAMES.get(small, small))


def split_unit(name: str, *, brackets: bool = False) -> tuple[str, Unit] | None:
    """Split a name into its quantity and the unit at its end: "x_mm", "x [mm]", "x (mm)", "x in mm".

    Args:
        name: Name of a column.
        brackets: Whether a unit counts only in brackets.

    Returns:
        Quantity and unit; None if the name does not end with a unit.
    """
    name = " ".join(name.split())  # the patterns take long on runs of blanks
    if len(name) > MAX_NAME_LENGTH:
        return None
    for pattern in (BRACKETS,) if brackets else (BRACKETS, TAIL):
        if found := pattern.match(name):
            unit = find_unit(found[2])
            if unit is None or not found[1]:
                continue
            if pattern is BRACKETS or unit.name not in LETTERS or column_meaning(found[1]) == "mass":
                return found[1], unit
    return None


XYZ = ("x", "y", "z")
WHEN = ("before", "after")
ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
"""Entries of a symmetric matrix that files hold."""
STATES = {"before": ("before", "unloaded"), "after": ("after", "loaded")}
"""Our words for the two states of a run."""

DEFLECTION = "deflection"
"""What stands in the place of a state where a file has loaded minus unloaded positions."""

LOADING = ("on", "off")
"""Words for how a pair was read: the load put on, or put on and taken off before the unloaded reading."""

ALONG = ("feed", "cross", "axial")
"""Parts of a process force: along the feed, across it, along the spindle."""

WHOLE_NUMBER = -1  #: Index of a position whose axis a column of axes says.

Which = Literal["run", "pose", "marker", "station", "loading", "state", "axis", "label"]
Acting = Literal["joint", "mass", "force", "moment", "point", "set_point", "process"]
Read = Literal["reading", "rotation", "quaternion", "matrix", "torque", "temperature", "time"]
Scattered = Literal["covariance", "sigma", "deviation", "turn_deviation", "spread", "tilt", "fixed_sigma"]
Along = Literal["travel", "distance", "direction", "fixed", "zero_sigma"]
What = Which | Acting | Read | Scattered | Along | Literal["series", "series_frame", "series_target"]
ROTATIONS: tuple[What, ...] = ("rotation", "quaternion", "matrix")
"""Notations of an orientation."""
SI: Mapping[What, tuple[str, ...]] = {
    **{"joint": ("rad", "m"), "torque": ("Nm", "N"), "sigma": ("m", "rad"), "mass": ("kg",)},
    **{"force": ("N",), "process": ("N",), "moment": ("Nm",), "covariance": ("m2",), "spread": ("m2",)},
    **{"point": ("m",), "set_point": ("m",), "reading": ("m",), "deviation": ("m",)},
    **{"rotation": ("rad",), "turn_deviation": ("rad",), "tilt": ("rad",)},
    **dict.fromkeys(("travel", "distance", "fixed", "fixed_sigma", "zero_sigma"), ("m",)),
}
"""Of every quantity with a unit what its unit may be a multiple of."""


@dataclass(frozen=True)
class Slot:
    """Describe the quantity of one column."""

    what: What  #: The quantity.
    index: int = 0  #: Number of the joint from 0, the axis or WHOLE_NUMBER, or the entry of a covariance.
    marker: str = ""  #: Of a reading; empty where a column of markers says it.
    when: str = ""  #: "before", "after" or DEFLECTION; empty where a column of states or the load says it.


COLUMNS: Mapping[What, tuple[str, Sequence[str]]] = {
    "force": ("force_{}_N", XYZ),
    "moment": ("moment_{}_Nm", XYZ),
    "point": ("point_{}_m", XYZ),
    "reading": ("position_{}_m", XYZ),
    "covariance": ("deflection_cov_{}_m2", tuple(ENTRIES)),
    "spread": ("position_cov_{}_m2", tuple(ENTRIES)),
    "deviation": ("sigma_{}_m", XYZ),
    "turn_deviation": ("sigma_rotation_{}_rad", XYZ),
    "rotation": ("rotation_{}_rad", XYZ),
    "quaternion": ("quaternion_{}", "wxyz"),
    "matrix": ("rotation_{}", [f"{i}{j}" for i in "123" for j in "123"]),
    "direction": ("direction_{}", XYZ),
    "fixed": ("fixed_{}_m", XYZ),
    "set_point": ("{}_mm", XYZ),
    "process": ("{}_force_N", ALONG),
}
"""Of quantities of several numbers, the columns of our files."""


def columns_of(what: What, when: str = "") -> dict[str, Slot]:
    """List the columns of a quantity with several components.

    Args:
        what: The quantity.
        when: "before" or "after" for readings and rotations of one state; "" otherwise.

    Returns:
        Name in our files and meaning of each component, in order.
    """
    pattern, parts = COLUMNS[what]
    if when:
        pattern = f"{when}_{{}}_m" if what == "reading" else f"rotation_{when}_{{}}_rad"
    return {pattern.format(part): Slot(what, k, when=when) for k, part in enumerate(parts)}


def torque_columns(arm: Arm) -> dict[str, Slot]:
    """List the columns of the joints' torques.

    Args:
        arm: The arm.

    Returns:
        Quantities by our names of the columns, such as "torque_joint_1_Nm".
    """
    units = ("N" if joint.prismatic else "Nm" for joint in arm.file_joints)
    both = zip(arm.file_joints, units, strict=True)
    return {f"torque_{joint.name}_{unit}": Slot("torque", k) for k, (joint, unit) in enumerate(both)}


def _without_unit(every: Mapping[str, Slot]) -> dict[str, Slot]:
    return {parts[0] if (parts := split_unit(name)) else name: slot for name, slot in every.items()}


def number_of(text: str) -> float | None:
    """Read a number with a decimal point or a decimal comma.

    Args:
        text: A cell.

    Returns:
        The number; None for any other text.
    """
    pointed = text.replace(",", ".")
    return float(pointed) if is_decimal(pointed) else None


def are_markers(texts: Iterable[str], arm: Arm) -> bool:
    """Tell whether texts are all names of an arm's markers, whatever their case and blanks.

    Args:
        texts: The texts.
        arm: The arm.

    Returns:
        Whether they are.
    """
    return {*map(squeeze, texts)} <= {*map(squeeze, arm.markers)}


def squeeze(text: str) -> str:
    """Remove case, blanks, hyphens and underscores from a name: names are compared in this form.

    Args:
        text: The name.

    Returns:
        The squeezed name.
    """
    return re.sub(r"[\s_\-]+", "", text).casefold()


def our_names(arm: Arm) -> dict[str, Slot]:
    """List the quantities of an arm's runs.

    Args:
        arm: The arm.

    Returns:
        Quantities by squeezed name, without unit.
    """
    single: tuple[What, ...] = ("run", "pose", "marker", "station", "state", "loading", "mass", "sigma")
    found: dict[str, Slot] = {name: Slot(name) for name in single}
    found |= {"load_kg": Slot("mass")}  # as in plan.csv
    found |= {"when": Slot("state"), "axis": Slot("axis"), "position": Slot("reading", WHOLE_NUMBER)}
    for when, words in {**STATES, DEFLECTION: (DEFLECTION,)}.items():
        found |= {word: Slot("reading", WHOLE_NUMBER, when=when) for word in words}
    for what in ("force", "moment", "point", "covariance", "deviation", "direction", "fixed"):
        found |= _without_unit(columns_of(what))
    found |= {"tilt": Slot("tilt"), "fixed_sigma": Slot("fixed_sigma"), "travel": Slot("travel")}
    for when, words in STATES.items():
        for word in words:
            found |= {
                f"travel_{word}": Slot("travel", when=when),
                f"distance_{word}": Slot("distance", when=when),
            }
    for when in WHEN:
        found |= _without_unit(columns_of("rotation", when))
    for k, axis in enumerate(XYZ):
        for marker in ("", *arm.markers):
            for when, words in {"": ("",), **STATES, DEFLECTION: (DEFLECTION,)}.items():
                orders = (order for word in words for order in permutations((marker, word, axis)))
                found |= {"_".join(order): Slot("reading", k, marker, when) for order in orders}
    joints = arm.file_joints
    if not any(joint.name.startswith("joint_") for joint in joints):
        found |= {f"joint_{k}": Slot("joint", k - 1) for k in range(1, len(joints) + 1)}
    found |= {joint.name: Slot("joint", k) for k, joint in enumerate(joints)}
    return {squeeze(name): slot for name, slot in found.items()}


def series_names(arm: Arm) -> dict[str, Slot]:
    """List the quantities of absolute readings: those of `our_names` and further ones.

    The further ones are orientations, noise by axis, torques, temperature and time.

    Args:
        arm: The arm.

    Returns:
        Quantities by squeezed name, without unit.
    """
    found = {"payload": Slot("mass"), "timestamp": Slot("time")}
    found |= {"distance": Slot("distance"), "height": Slot("distance"), "zero_sigma": Slot("zero_sigma")}
    found |= {name: Slot(name) for name in ("series", "series_frame", "series_target")}
    for unit in ("", "_c", "_degc", "[c]", "[°c]", "[degc]", "(c)", "(°c)", "(degc)"):
        found |= {f"temperature{unit}": Slot("temperature")}
    for unit in ("", "_s", "[s]", "(s)"):
        found |= {f"time{unit}": Slot("time", int(bool(unit)))}
    for what in ("reading", "rotation", "quaternion", "matrix", "turn_deviation", "spread"):
        found |= _without_unit(columns_of(what))
    found |= {f"rotation_{k}": Slot("rotation", 2 + k) for k in (1, 2, 3)}
    for k, part in enumerate("wxyz"):
        found |= {f"{name}_{part}": Slot("quaternion", k) for name in ("quat", "q")}
    found |= {f"torque_{k}": Slot("torque", k - 1) for k in range(1, len(arm.file_joints) + 1)}
    found |= _without_unit(torque_columns(arm))
    return {squeeze(name): slot for name, slot in found.items()} | our_names(arm)


def program_names(arm: Arm) -> dict[str, Slot]:
    """List the quantities of a robot's program.

    Args:
        arm: The arm.

    Returns:
        Quantities by squeezed name, without unit.
    """
    shared = ("joint", "mass", "force", "moment", "point", *ROTATIONS)
    kept = {name: slot for name, slot in series_names(arm).items() if slot.what in shared and not slot.when}
    found = {name: Slot("label") for name in ("label", "point", "name")}
    for k, axis in enumerate(XYZ):
        found |= {f"{what}{axis}": Slot("set_point", k) for what in ("", "position_")}
    for k, along in enumerate(ALONG):
        found |= {f"{along}{what}": Slot("process", k) for what in ("", "_force")}
    return kept | {squeeze(name): slot for name, slot in found.items()}


def recognise(name: str, known: Mapping[str, Slot]) -> tuple[Slot, Unit | None] | None:
    """Find the quantity and the unit that a column's name states.

    Args:
        name: Name of the column.
        known: Quantities by squeezed name, see `squeeze`.

    Returns:
        The quantity, and its unit, or None where the name has none; None for an unknown name.
    """
    whole = known.get(squeeze(name))
    if whole is not None:
        return whole, None
    parts = split_unit(name)
    slot = None if parts is None else known.get(squeeze(parts[0]))
    if parts is None or slot is None or parts[1].si not in SI.get(slot.what, ()):
        return None
    return slot, parts[1]


def placeholders(
    arm: Arm, words: Mapping[str, tuple[str, ...]]
) -> dict[str, list[tuple[str, tuple[str, ...]]]]:
    """List the words that may replace {n}, {n0}, {joint}, {axis}, {marker} and {when} in a map's patterns.

    Args:
        arm: The arm, whose joints and markers have names.
        words: Further words of the map, by our word.

    Returns:
        For each placeholder our words, each with the words that files use for it.
    """
    joints = [joint.name for joint in arm.file_joints]
    return {
        "n": [(name, (str(k),)) for k, name in enumerate(joints, start=1)],
        "n0": [(name, (str(k),)) for k, name in enumerate(joints)],
        "joint": [(name, (name,)) for name in joints],
        "axis": [(axis, (axis,)) for axis in XYZ],
        "marker": [(name, (name, *words.get(name, ()))) for name in arm.markers],
        "when": [(when, (*STATES[when], *words.get(when, ()))) for when in WHEN],
    }


def expand(
    ours: str, theirs: str, choices: Mapping[str, list[tuple[str, tuple[str, ...]]]]
) -> Iterator[tuple[str, str]]:
    """Generate the pairs of names that two patterns with the same placeholder stand for.

    Args:
        ours: Pattern of our names, such as "joint_{n}".
        theirs: Pattern of the file's names, such as "A{n}".
        choices: Words for every placeholder, from `placeholders`.

    Yields:
        Our name, and the file's name.
    """
    for key, values in choices.items():
        hole = f"{{{key}}}"
        numbered = f"joint_{hole}"  # joint_{n} is the n-th joint, whatever its name
        own = numbered if key in ("n", "n0") and numbered in ours else hole
        if own in ours:
            for our, words in values:
                for word in words:
                    yield from expand(ours.replace(own, our), theirs.replace(hole, word), choices)
            return
    yield ours, theirs


# --- Meaning of columns by their names: joints of one family, positions of targets, and unread columns ------

BESIDE = {*KNOWN_EXPORTS["beside"]["words"]}  #: Words that stand beside those of a state.
STATE_OF_WORD: dict[str, str] = {
    squeeze(word): state for state, words in KNOWN_EXPORTS["states"].items() for word in words
}
STATE_WORDS = "|".join(map(re.escape, sorted(STATE_OF_WORD, key=len, reverse=True)))
"""An expression of any word for a state in the name of a column."""
STATE_OF_CELL: dict[str, str] = STATE_OF_WORD | {
    squeeze(word): state for state, words in KNOWN_EXPORTS["answers"].items() for word in words
}
LOADS = ("N", "Nm", "kg")  #: Units of forces, moments and masses.
DEGREES = re.compile(KNOWN_EXPORTS["prefixed"]["degrees"])
PREFIXED = re.compile(KNOWN_EXPORTS["prefixed"]["joint"])
OTHER_WORD = re.compile(rf"\b(?:{KNOWN_EXPORTS['prefixed']['other']})\b")
NUMBER = re.compile(r"\d+")
NEVER = "(?!)"  #: Matches nothing.


class Place(NamedTuple):
    """Describe a column of positions: target, state and axis."""

    target: str  #: As the name has it, plain; "" where it names none.
    when: str  #: "before", "after" or DEFLECTION; "" where it says no state.
    axis: str

    def ours(self, targets: Mapping[str, str]) -> str:
        """Write our name for the column, such as "P1_before_x".

        Args:
            targets: Our names of the targets, by their plain names.

        Returns:
            The name; target or state are left out if the column states none.
        """
        return "_".join(filter(None, (targets[self.target], self.when, self.axis)))


def state_of(text: str) -> str:
    """Find the state that a text names, such as "no load", "with 240 kg" or "Loaded (2)".

    Args:
        text: A cell, a line or the name of a sheet.

    Returns:
        "before" or "after"; "" if it names none, both, or holds words that nobody knows.
    """
    words = [word for word in re.findall(r"[^\W\d_]+", text.casefold()) if word not in BESIDE]
    for whole in (squeeze(text), "".join(words)):
        if whole in STATE_OF_CELL:
            return STATE_OF_CELL[whole]
    found = {STATE_OF_CELL.get(word, "") for word in words}
    return found.pop() if len(found) == 1 else ""


def plain(name: str) -> str:
    """Reduce a name to small letters and digits, without its unit.

    Args:
        name: Name of a column.

    Returns:
        The reduced name.
    """
    return re.sub(r"[\W_]+", "", (split_unit(name) or (name,))[0]).casefold()


def _words(name: str) -> str:
    """Divide a name into words of small letters and digits, without its unit: "AIPos.A1" gives "aipos a1"."""
    return " ".join(re.findall(r"[^\W_]+", (split_unit(name) or (name,))[0].casefold()))


def column_meaning(name: str) -> str:
    """Find the quantity of a column by its name alone.

    Args:
        name: Name of the column.

    Returns:
        The quantity; "" for an unknown name, and for positions.
    """
    word = plain(name)
    found = ((ours, re.fullmatch(own, word)) for ours, own in KNOWN_EXPORTS["columns"].items())
    return next((ours.format(**match.groupdict()) for ours, match in found if match), "")


def places(arm: Arm) -> Callable[[str], Place | None]:
    """Make a function that finds target, state and axis in a name, in any order.

    Args:
        arm: The arm, with the names of its markers.

    Returns:
        A function of a name; it returns None if the name is not that of a position.
    """
    markers = sorted(filter(None, map(plain, arm.markers)), key=len, reverse=True)
    target = "|".join([*map(re.escape, markers), KNOWN_EXPORTS["places"]["target"]])
    moved, said = (KNOWN_EXPORTS["places"][kind] for kind in ("moved", "said"))
    words = re.compile(rf"(?P<target>{target})|(?P<when>{STATE_WORDS}|{moved})|{said}")

    def place(name: str) -> Place | None:
        text = plain(name)
        for k in (k for k, axis in enumerate(text) if axis in XYZ):
            found = [*words.finditer(f"{text[:k]} {text[k + 1 :]}")]
            targets, whens = ([m[kind] for m in found if m[kind]] for kind in ("target", "when"))
            whole = sum(len(m[0]) for m in found) == len(text) - 1
            if whole and len(targets) < 2 and len(whens) < 2:
                when = STATE_OF_WORD.get(whens[0], DEFLECTION) if whens else ""
                return Place("".join(targets), when, text[k])
        return None

    return place


def numbered_places(names: Sequence[str], arm: Arm) -> dict[str, Place]:
    """Find positions whose axes are numbered, such as pos_1, pos_2, pos_3.

    Args:
        names: Names of all columns; those of the arm's markers, such as P1, number targets, not axes.
        arm: The arm, with the names of its markers.

    Returns:
        Target, state and axis of each such name; a family of other numbers than three in turn has none.
    """
    numbered = re.compile(rf"(?P<rest>.*?)(?:{KNOWN_EXPORTS['places']['numbered']})(?P<n>\d+)")
    place, families = places(arm), dict[str, dict[int, str]]()
    for name in names:
        if not are_markers([plain(name)], arm) and (match := numbered.fullmatch(plain(name))):
            families.setdefault(match["rest"], {})[int(match["n"])] = name
    found = dict[str, Place]()
    for rest, own in families.items():
        at = place(f"{rest}x") if rest else Place("", "", "x")
        if at and sorted(own) in ([0, 1, 2], [1, 2, 3]):
            found |= {own[n]: at._replace(axis=axis) for n, axis in zip(sorted(own), XYZ, strict=True)}
    return found


def joints_of(arm: Arm) -> Callable[[str], tuple[str, int] | None]:
    """Make a function that finds a joint's number in a name, and the family of names to which it belongs.

    Args:
        arm: The arm, with the names of its joints.

    Returns:
        A function of a name; it returns None if the name is not that of a joint.
    """
    numbers = {plain(joint.name): k for k, joint in enumerate(arm.file_joints, start=1)}
    spoken = "|".join(map(re.escape, sorted(filter(None, numbers), key=len, reverse=True))) or NEVER
    named = re.compile(KNOWN_EXPORTS["joints"]["named"].replace("NAME", spoken))

    def joint(name: str) -> tuple[str, int] | None:
        text, (kind, _, number) = plain(name), column_meaning(name).partition(" ")
        if kind == "joint":
            return "#".join(text.rsplit(number, 1)), int(number)
        words = _words(name)
        if (own := PREFIXED.fullmatch(words)) and not OTHER_WORD.search(words):
            return f"{words[: own.start('n')]}#{words[own.end('n') :]}", int(own["n"])
        if own := named.fullmatch(text):
            return text.replace(own["name"], "##"), numbers[own["name"]]
        return None

    return joint


def joint_family(names: Sequence[str], arm: Arm) -> list[int]:
    """Find the columns of an arm's joints by their names, such as A1 to A6.

    All of them belong to one family of names, numbered from 1 or from 0. A family with exactly as many
    members as the arm has joints is preferred. Without one, a known order of words counts, such as S, L, U,
    R, B, T.

    Args:
        names: Names of all columns.
        arm: The arm.

    Returns:
        Places of the columns in the order of the joints; empty if no family is complete.
    """
    return next(iter(joint_families(names, arm)), [])


def joint_families(names: Sequence[str], arm: Arm) -> list[list[int]]:
    """List all complete sets of columns that `joint_family` may choose, its choice first.

    Args:
        names: Names of all columns.
        arm: The arm.

    Returns:
        Places of the columns of each set, in the order of the joints.
    """
    families: dict[str, dict[int, int]] = {}
    read = joints_of(arm)
    n = len(arm.file_joints)
    whole = list[tuple[bool, list[int]]]()
    for column, name in enumerate(names):
        if own := read(name):
            families.setdefault(own[0], {}).setdefault(own[1], column)
    for family, found in families.items():
        if family == "q#" and sorted(found) in ([0, 1, 2, 3], [1, 2, 3, 4]) and n != len(found):
            continue  # a quaternion
        first = 1 if {*range(1, n + 1)} <= {*found} else 0
        if {*range(first, n + first)} <= {*found}:
            whole.append((len(found) > n, [found[k] for k in range(first, n + first)]))
    place = {plain(name): column for column, name in reversed([*enumerate(names)])}
    for words in (own.split() for own in KNOWN_EXPORTS["joints"]["orders"]):
        if not whole and len(words) == n and {*words} <= {*place}:
            whole.append((False, [place[word] for word in words]))
    return [columns for _, columns in sorted(whole, key=lambda own: own[0])]


def unread_column_warnings(names: Sequence[str]) -> list[str]:
    """Write warnings about unread columns that look like orientations, joints, times or loads.

    Args:
        names: Names of the unread columns.

    Returns:
        One warning per kind of quantity.
    """
    left = {name: plain(name) for name in names}
    kinds: dict[str, list[str]] = {}
    for kind, sets in KNOWN_EXPORTS["together"].items():
        for words in (own.split() for own in sets):
            found = [name for name, text in left.items() if text in words]
            if {left[name] for name in found} == {*words} and f"q{len(words) + 1}" not in left.values():
                kinds.setdefault(kind, []).extend(found)
                left = {name: text for name, text in left.items() if name not in found}
    for name in left:
        if kind := next((kind for kind in KNOWN_EXPORTS["alone"] if looks_like(name, kind)), ""):
            kinds.setdefault(kind, []).append(name)
    return [
        f"warning: these columns look like {kind} and are not read: {some_of(own)}"
        for kind, own in kinds.items()
    ]


def looks_like(name: str, kind: str) -> bool:
    """Tell whether the name or the unit of a column suggests a kind of quantity.

    Args:
        name: Name of the column.
        kind: "orientations", "joints", "times" or "loads".

    Returns:
        True if it does.
    """
    parts = split_unit(name)
    loaded = parts is not None and parts[1].si in LOADS and parts[1].name not in LETTERS
    return (kind == "loads" and loaded) or re.fullmatch(KNOWN_EXPORTS["alone"][kind], plain(name)) is not None


# --- Loads in words, and codes that a legend explains -------------------------------------------------------

TERM = re.compile(
    r"(?<![\d.,])(?:(?P<count>\d+)\s*[x×*]\s*)?(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>kg|lbs?|t)\b",
    re.IGNORECASE,
)
"""A mass in a text, such as "with 150 kg", or several equal ones, such as "3 x 50 kg"."""
THOUSANDS = re.compile(r"(?<![\d.,])[1-9][.,' \u00a0\u202f]\d{3}(?:[.,]\d+)?\s*(?:kg|lb|t\b)", re.IGNORECASE)
"""A mass that may be one or a thousand: "1,000 lb"."""
COUNTED = re.compile(r"(?<![\w.,])\d+\s+(?:[^\W\d]+\s+)*@?\s*$")
"""A number before a mass that may count it, as in "2 plates of 20 kg"; that of "Load 2: 20 kg" does not."""
ALONE = re.compile(r"(?<![\w.,])\d+(?![\w])")  #: A number of its own behind a mass, as in "20 kg (2 times)".
MAX_CODES = 12  #: Most codes of loads that a legend may explain.


def masses_in(texts: Sequence[str]) -> dict[str, str]:
    """Find the masses of texts such as "no load", "with 240 kg" and "2 x 20 kg + 5 kg", all in one unit.

    Args:
        texts: The texts of a column, or the names of sheets.

    Returns:
        The mass of each text, as "240 kg" or "0"; empty unless each has one or says that none hangs.
    """
    found = {text: _mass_in(text) for text in dict.fromkeys(texts)}
    units = {mass.partition(" ")[2] for mass in found.values()} - {""}
    return found if len(units) == 1 and all(found.values()) else {}


def _mass_in(text: str) -> str:
    """The mass of a text, "0" where it says that none hangs; "" where nobody knows it."""
    terms = [*TERM.finditer(text)]
    if not terms:
        return "0" if state_of(text) == "before" else ""
    between = [text[a.end() : b.start()].strip() for a, b in pairwise(terms)]
    units = {term["unit"].casefold()[:2] for term in terms}
    unclear = len(units) > 1 or {*between} - {"+"} or THOUSANDS.search(text)
    if unclear or COUNTED.search(text[: terms[0].start()]) or ALONE.search(text[terms[-1].end() :]):
        return ""
    whole = sum(int(term["count"] or 1) * float(term["number"].replace(",", ".")) for term in terms)
    if whole and state_of(text) == "before":
        return ""
    return f"{whole:.12g} {units.pop()}" if whole else "0"


def explained(codes: Sequence[str], text: str) -> dict[str, str]:
    """Find what a legend says of codes, such as "L1 = 150 kg" in a line beside the table.

    Args:
        codes: The codes, such as those of a column of loads.
        text: The text of the file.

    Returns:
        The meaning of each code; empty unless the file explains each of them in one way.
    """
    if not 1 < len(codes) <= MAX_CODES or not all(codes):
        return {}
    found = {}
    for code in codes:
        told = re.findall(rf"(?<!\w){re.escape(code)}[ ]*[=:][ ]*([^;,|\t\r\n]*[^\s;,|\"])", text)
        if len({*told}) != 1:
            return {}
        found[code] = told[0]
    return found
