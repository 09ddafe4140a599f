"""Meaning of columns by their names: joints of one family, positions of targets, and unread columns."""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from testbench.arm.folder import Arm
from testbench.files.names import XYZ, split_unit, squeeze

KNOWN_EXPORTS = tomllib.loads(Path(__file__).with_name("exports.toml").read_text(encoding="utf-8"))
STATE_OF_WORD = {squeeze(word): state for state, words in KNOWN_EXPORTS["states"].items() for word in words}
LOADS = ("N", "Nm", "kg")  #: Units of forces, moments and masses.
NUMBER = re.compile(r"\d+")
NEVER = "(?!)"  #: Matches nothing.
MAX_LISTED = 9  #: Columns that a warning names.


class Place(NamedTuple):
    """Describe a column of positions: target, state and axis."""

    target: str  #: As the name has it, plain; "" where it names none.
    when: str  #: "before", "after", or "" where it says no state.
    axis: str

    def ours(self, targets: Mapping[str, str]) -> str:
        """Write our name for the column, such as "P1_before_x".

        Args:
            targets: Our names of the targets, by their plain names.

        Returns:
            The name; target or state are left out if the column states none.
        """
        return "_".join(filter(None, (targets[self.target], self.when, self.axis)))


def plain(name: str) -> str:
    """Reduce a name to small letters and digits, without its unit.

    Args:
        name: Name of a column.

    Returns:
        The reduced name.
    """
    return re.sub(r"[\W_]+", "", (split_unit(name) or (name,))[0]).casefold()


def column_meaning(name: str) -> str:
    """Find the quantity of a column by its name alone.

    Args:
        name: Name of the column.

    Returns:
        The quantity; "" for an unknown name, and for positions.
    """
    found = ((ours, re.fullmatch(own, plain(name))) for ours, own in KNOWN_EXPORTS["columns"].items())
    return next((ours.format(**match.groupdict()) for ours, match in found if match), "")


def places(arm: Arm) -> Callable[[str], Place | None]:
    """Make a function that finds target, state and axis in a name, in any order.

    Args:
        arm: The arm, with the names of its markers.

    Returns:
        A function of a name; it returns None if the name is not that of a position.
    """
    markers = sorted(filter(None, map(plain, arm.markers)), key=len, reverse=True)
    states = "|".join(map(re.escape, sorted(STATE_OF_WORD, key=len, reverse=True)))
    target = "|".join([*map(re.escape, markers), KNOWN_EXPORTS["places"]["target"]])
    words = re.compile(rf"(?P<target>{target})|(?P<when>{states})|{KNOWN_EXPORTS['places']['said']}")

    def place(name: str) -> Place | None:
        text = plain(name)
        for k in (k for k, axis in enumerate(text) if axis in XYZ):
            found = [match for part in (text[:k], text[k + 1 :]) for match in words.finditer(part)]
            targets, whens = ([m[kind] for m in found if m[kind]] for kind in ("target", "when"))
            whole = sum(len(m[0]) for m in found) == len(text) - 1
            if whole and len(targets) < 2 and len(whens) < 2:
                return Place("".join(targets), STATE_OF_WORD["".join(whens)] if whens else "", text[k])
        return None

    return place


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
        if own := named.fullmatch(text):
            return text.replace(own["name"], "##"), numbers[own["name"]]
        return None

    return joint


def joint_family(names: Sequence[str], arm: Arm) -> list[int]:
    """Find the columns of an arm's joints by their names, such as A1 to A6.

    All of them belong to one family of names, numbered from 1 or from 0. A family with exactly as many
    members as the arm has joints is preferred.

    Args:
        names: Names of all columns.
        arm: The arm.

    Returns:
        Places of the columns in the order of the joints; empty if no family is complete.
    """
    families: dict[str, dict[int, int]] = {}
    read, n, whole = joints_of(arm), len(arm.file_joints), list[tuple[bool, list[int]]]()
    for column, name in enumerate(names):
        if own := read(name):
            families.setdefault(own[0], {}).setdefault(own[1], column)
    for family, found in families.items():
        if family == "q#" and sorted(found) in ([0, 1, 2, 3], [1, 2, 3, 4]) and n != len(found):
            continue  # a quaternion
        first = 1 if {*range(1, n + 1)} <= {*found} else 0
        if {*range(first, n + first)} <= {*found}:
            whole.append((len(found) > n, [found[k] for k in range(first, n + first)]))
    return min(whole, key=lambda own: own[0])[1] if whole else []


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
        f"warning: these columns look like {kind} and are not read: {', '.join(own[:MAX_LISTED])}"
        + f" and {len(own) - MAX_LISTED} more" * (len(own) > MAX_LISTED)
        for kind, own in kinds.items()
    ]


def looks_like(name: str, kind: str) -> bool:
    """Tell whether the name or the unit of a column suggests a kind of quantity.

    Args:
        name: Name of the column.
        kind: "orientations", "joints", "times" or "forces".

    Returns:
        True if it does.
    """
    parts = split_unit(name)
    loaded = kind == "forces" and parts is not None and parts[1].si in LOADS
    return loaded or re.fullmatch(KNOWN_EXPORTS["alone"][kind], plain(name)) is not None
