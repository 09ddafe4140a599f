"""Numbers in files of drivers and controllers, found and exchanged; every other character stays.

- Universal Robots: `kinematics` that ur_description reads, pose of every joint's frame in the one before, its
  z axis the joint's [m, rad]. `hash` names the controller's own calibration, which stays as it is.
- KUKA: `$MAMES` of `$machine.dat`, angle of an axis where it is mastered [deg] (KR C2, Machine Data, 2.1.7).
- ABB: `cal_offset` of MOTOR_CALIB in MOC.cfg, angle of a motor where its axis is calibrated [rad].
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.errors import InputError, read_bytes

NUMBER = r"(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])"
UR_LINE = re.compile(rf"(?m)^[ \t]+(?P<key>\w+):[ \t]*(?:{NUMBER})?[ \t]*(?:#.*)?\r?$")
KUKA_LINE = re.compile(rf"(?mi)^[ \t]*\$MAMES\[(?P<key>\d+)\][ \t]*=[ \t]*{NUMBER}")
ABB_PART = re.compile(r"(?m)^MOTOR_CALIB:[^#]*")
ABB_AXIS = re.compile(rf'-name\s+"(?P<key>[^"]*)"(?:(?!-name\s).)*?\s-cal_offset\s+{NUMBER}', re.DOTALL)
STAMP = "testbench export: as identified; what this cannot hold is in the JSON beside it"
MAX_BYTES = 16_000_000
Numbers = Mapping[str, re.Match[str]]
"""Where the number of every key stands."""


@dataclass(frozen=True)
class Format:
    """A kind of file."""

    title: str  #: For people.
    name: str  #: Of one key in the file, `{}` for the key.
    find: Callable[[str], Iterator[re.Match[str]]]
    decimals: int  #: Of a number that is written.
    comment: str  #: Begins one.
    head: str  #: Regular expression of what stands before our comment.


def _abb(text: str) -> Iterator[re.Match[str]]:
    for part in ABB_PART.finditer(text):
        yield from ABB_AXIS.finditer(text, *part.span())


UR = Format("kinematics of a UR driver", "{}", UR_LINE.finditer, 12, "#", "")
KUKA = Format("KUKA's $machine.dat", "$MAMES[{}]", KUKA_LINE.finditer, 8, ";", r"(?is)(.*?^DEFDAT.*?\n)?")
ABB = Format("ABB's MOC.cfg", 'cal_offset of "{}"', _abb, 8, "#", r"[^\n]*\n")


def read_controller(file: Path) -> str:
    """The text of a file in whatever encoding: a byte a character."""
    return read_bytes(file, MAX_BYTES).decode("latin-1")


def find_numbers(form: Format, file: Path, text: str, keys: Sequence[str]) -> Numbers:
    """Where the numbers of some keys stand in a text, once each; InputError where they do not."""
    found: dict[str, re.Match[str]] = {}
    frame = ""
    for match in form.find(text):
        if match["number"] is None:
            frame = f"{match['key']}."
        elif (key := frame + match["key"]) in found:
            raise InputError(file, form.name.format(key), "stands twice")
        else:
            found[key] = match
    for key in keys:
        if key not in found or not math.isfinite(float(found[key]["number"])):
            raise InputError(file, "", f"expected {form.title} with a number at {form.name.format(key)}")
    return {key: found[key] for key in keys}


def exchanged(form: Format, text: str, numbers: Numbers, values: Mapping[str, float]) -> str:
    """The text with other numbers, and our stamp in a comment."""
    for key, match in sorted(numbers.items(), key=lambda pair: -pair[1].start("number")):
        start, end = match.span("number")
        text = f"{text[:start]}{round(values[key], form.decimals) + 0.0:.{form.decimals}f}{text[end:]}"
    newline = "\r\n" if "\r\n" in text else "\n"
    head = re.match(form.head, text, re.MULTILINE)
    at = head.end() if head else 0
    return f"{text[:at]}{form.comment} {STAMP}{newline}{text[at:]}"
