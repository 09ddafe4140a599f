"""Colour is a role, the same in figures and recordings (Okabe-Ito), and never alone: shapes go with it.

Least squares is orange, brown where its free directions make it conservative, joints alone are blue, GCO is
green, measured vermillion, nominal sky blue, load purple, the arm grey. A model has one shade of its family
by its structure's name, never by its rank; a prior fills its marker.
"""

from dataclasses import dataclass

from testbench.identify import Constraint

Colour = tuple[int, ...]

NOMINAL, MEASURED, LOAD, GREY = (86, 180, 233), (213, 94, 0), (204, 121, 167), (127, 127, 127)
"""Sky blue, vermillion, purple, grey."""
SCALE: tuple[Colour, ...] = ((72, 98, 140), (36, 118, 142), (84, 134, 92), (154, 128, 40), (216, 116, 16))
"""Of sizes, from least to greatest: blue-grey to orange, brighter all the way, seen on dark and on light."""
TASK = (178, 156, 48)  #: Where the robot works: olive, which is neither least squares nor GCO.
ORANGES: tuple[Colour, ...] = ((230, 159, 0), (176, 122, 72), (205, 170, 105))
"""Least squares."""
BROWNS: tuple[Colour, ...] = ((150, 105, 20),)
"""Least squares whose free directions make it conservative."""
JOINTS = (0, 114, 178)
"""Joints alone, what most calibrations use: beside links they are no shade of a method."""
GREENS: tuple[Colour, ...] = ((0, 158, 115), (124, 190, 92), (72, 150, 160), (100, 140, 60), (150, 205, 180))
"""GCO."""
FAMILIES = {"none": ORANGES, "psd": GREENS, "free": BROWNS}
PLACES = {
    "MLS56": 0,
    "MLS32": 1,
    "MLS36": 0,
    "MLS21": 1,
    "MGCO21": 0,
    "MGCO56": 0,
    "MGCO68": 1,
    "MGCO69": 1,
    "MGCO47": 2,
    "MGCO147": 3,
    "ALL153": 4,
}
"""Shade of a structure in its family; others take one by their letters."""
MARKS = "osD^vP"  #: Marker of each shade, matplotlib's letters.


@dataclass(frozen=True)
class Look:
    """How a model is drawn."""

    colour: Colour  #: Of its family, in the shade of its structure.
    place: int  #: Of the shade in the family, for shapes.
    prior: bool  #: Whether a prior stands behind it: dashed lines, filled markers.

    @property
    def hex(self) -> str:
        """The colour as #RRGGBB."""
        return hexadecimal(self.colour)

    @property
    def mark(self) -> str:
        """Matplotlib's marker."""
        return MARKS[self.place % len(MARKS)]


CHOICE = Look((0, 0, 0), 3, prior=True)
"""What is chosen by default, whatever it is: black."""


def look(structure: str, constraint: Constraint, prior: bool = False) -> Look:
    """The look of a model.

    Args:
        structure: Name of its structure.
        constraint: What its method asks of the blocks.
        prior: Whether it has a prior.
    """
    if structure == "Joints":
        return Look(JOINTS, 2, prior)
    family = FAMILIES[constraint]
    place = PLACES.get(structure, sum(map(ord, structure)) % len(family))
    if constraint == "free":  # beside least squares of the same structure
        place = len(MARKS) - 1
    return Look(family[place % len(family)], place, prior)


def hexadecimal(colour: Colour) -> str:
    """A colour as #RRGGBB."""
    return "#" + "".join(f"{part:02X}" for part in colour[:3])
