"""Units of a file, read from the names of its columns: all become SI at the door."""

import math
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """A unit of a file."""

    name: str  #: As we write it.
    si: str  #: What it is a multiple of.
    scale: float  #: How many of that it is.


INCH, POUND, STANDARD = 0.0254, 0.45359237, 9.80665
"""Of the inch [m], the pound [kg] and the acceleration that makes its force [m/s^2], exact by definition."""
UNITS = (
    *(Unit(n, "m", s) for n, s in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("in", INCH))),
    *(Unit(n, "rad", s) for n, s in (("rad", 1.0), ("mrad", 1e-3), ("deg", math.pi / 180))),
    *(Unit(n, "N", s) for n, s in (("N", 1.0), ("daN", 10.0), ("kN", 1e3), ("lbf", POUND * STANDARD))),
    Unit("kgf", "N", STANDARD),
    *(Unit(n, "Nm", s) for n, s in (("Nm", 1.0), ("Nmm", 1e-3))),
    *(Unit(n, "kg", s) for n, s in (("kg", 1.0), ("lb", POUND))),
    *(Unit(n, "m2", s) for n, s in (("m2", 1.0), ("mm2", 1e-6), ("um2", 1e-12))),
)
#: Of what is not zero, in any unit: its square is not zero, nor what is divided by it infinite.
LEAST = 1e-100
LARGEST = {"m": 1e6, "rad": 1e6, "N": 1e9, "Nm": 1e9, "kg": 1e6, "m2": 1e6}
"""Largest number of a quantity in SI that is read: beyond it a file is broken."""
OTHERS = {"deg": "° degree degrees 度", "um": "μm", "in": "inch inches", "mm": "millimeter millimeters"}
OTHER_NAMES = {
    other: unit for unit, words in {**OTHERS, "lb": "lbs", "nm": "n*m n·m"}.items() for other in words.split()
}
"""What files write for these, in small letters; both micro signs become the Greek letter."""
KNOWN = {unit.name.lower(): unit for unit in UNITS}
LONGEST = 200  #: Letters of the longest name that may end with a unit.
BRACKETS = re.compile(r"^(.*?)\s*[\[(]\s*([^\[\]()]+?)\s*[\])]$")
TAIL = re.compile(r"^(.*?)(?:\s*[/,]\s*|\s+(?i:in)\s+|[\s_]+)([^\s_/,\[\]()]+)$")


def find_unit(word: str) -> Unit | None:
    """The unit that a word names, whatever its case and its blanks; None for any other word."""
    small = "".join(word.casefold().split()).replace("²", "2")
    return KNOWN.get(OTHER_NAMES.get(small, small))


def split_unit(name: str, *, brackets: bool = False) -> tuple[str, Unit] | None:
    """What stands before a unit at the end of a name, and the unit: "x_mm", "x [mm]", "x (mm)", "x in mm".

    Args:
        name: Of a column.
        brackets: Whether a unit counts in brackets only.

    Returns:
        None where no unit stands there.
    """
    name = " ".join(name.split())  # the patterns take long on runs of blanks
    if len(name) > LONGEST:
        return None
    for pattern in (BRACKETS,) if brackets else (BRACKETS, TAIL):
        if found := pattern.match(name):
            unit = find_unit(found[2])
            if unit is not None and found[1]:
                return found[1], unit
    return None
