"""Colour is a role, the same in figures, recordings and pages, and never alone: shapes go with it.

A model has one colour, by its name: least squares orange, with a prior pink, vermillion where its free
directions make it conservative; joints alone blue; GCO green, grey without its trace weight. A prior fills
its marker and dashes its line. Measured is rust, nominal sky blue, the arm grey; purple is load and nothing
else. Every colour stands out from white and from black, by 3:1 at least; maps have their own ramp.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, TypedDict, runtime_checkable

from testbench.model.structure import PAPER_GCO_METHOD, Constraint

Colour = tuple[int, ...]


NOMINAL, MEASURED, LOAD, GREY = (40, 146, 196), (159, 85, 8), (196, 106, 160), (127, 127, 127)
"""Sky blue, rust, purple, grey."""
SCALE: tuple[Colour, ...] = (
    (62, 73, 137),
    (50, 100, 142),
    (40, 125, 142),
    (31, 149, 139),
    (38, 173, 129),
    (78, 195, 107),
    (134, 213, 73),
)
"""Of sizes, from least to greatest: viridis between 22 and 82 %, brighter all the way for every eye."""
TASK = (143, 119, 4)  #: Where the robot works: olive.
STIFFNESS = (0, 161, 154)  #: Where a force of any direction moves the tool: teal, an ellipsoid.
NEGATIVE = (200, 16, 46)  #: What no body can have, such as a negative compliance: red, always a cross.
LINK = (150, 150, 150)  #: Links beside joints.
LEAST_SQUARES, GCO = (200, 131, 4), (67, 131, 92)  #: The methods, and MLS56 and MGCO56.
JOINTS, JOINTS_PRIOR = (90, 142, 255), (108, 116, 192)
"""Joints alone, what most calibrations use: beside links they are no shade of a method."""
LEAST_SQUARES_PRIOR = (255, 80, 128)
DISTINCT = (LEAST_SQUARES, GCO, JOINTS, LEAST_SQUARES_PRIOR, MEASURED)
"""By everybody, also who sees no red or no green: CIEDE2000 of 15 at least between any two."""
SHADES: Mapping[tuple[Constraint, str], Mapping[str, Colour]] = {
    ("none", "none"): {"56": LEAST_SQUARES, "32": (176, 106, 98)},
    ("none", "prior"): {"56": LEAST_SQUARES_PRIOR, "68": (150, 86, 92), "153": (210, 116, 98)},
    ("free", "none"): {"56": (213, 94, 0)},
    ("ridge", "none"): {"56": (166, 118, 29)},
    ("clipped", "none"): {"56": (217, 119, 87)},
    ("psd", "none"): {
        "56": GCO,
        "68": (122, 151, 6),
        "47": (132, 150, 119),
        "147": (107, 107, 100),
        "153": (8, 162, 14),
    },
    ("psd", "paper"): {
        "56": (120, 150, 154),
        "68": (99, 106, 125),
        "47": (100, 136, 128),
        "147": (113, 115, 141),
        "153": (88, 116, 109),
    },
    ("psd", "prior"): {"56": (0, 120, 104), "68": (93, 112, 12), "153": (0, 161, 154)},
    ("psd", "least trace"): {"56": (42, 115, 98), "68": (157, 131, 83), "153": (103, 130, 159)},
    ("psd", "log-det prior"): {"56": (87, 153, 100), "68": (109, 127, 41), "153": (37, 129, 143)},
}
"""Colour by method, then by kind of structure."""
STRUCTURE_KINDS = {"MLS36": "56", "MLS21": "32", "MGCO21": "56", "MGCO69": "68"}
"""Kinds of structures that are not named by their count: never beside the one of that count."""
PLACES = {"Joints": 2, "56": 0, "32": 1, "68": 1, "47": 2, "147": 3, "153": 4}  #: Mark of a kind.
FULL = 21  #: Entries of a link in full, of which an arm of any joints has a multiple.
MARKS = "osD^vP*"  #: Markers, matplotlib's letters.


HELD: Mapping[Constraint, str] = {"free": "P", "ridge": "s", "clipped": "D"}
"""Marks of least squares that are held down in another way than by the cone."""

USER_COLOURS: tuple[Colour, ...] = ((206, 15, 95), (14, 91, 240), (248, 1, 23))
OWN_MARKS = "Pv^"
"""Of estimators of one's own in the order in which they are asked for: all colours with each mark."""

SERIES: tuple[Colour, ...] = (
    GCO,
    NOMINAL,
    LEAST_SQUARES,
    LEAST_SQUARES_PRIOR,
    (42, 115, 98),
    JOINTS_PRIOR,
    (184, 98, 18),
    (0, 161, 154),
)
"""What is no model, such as criteria, instruments and solvers."""


class Dots(TypedDict):
    """What matplotlib is told of dots."""

    marker: str
    color: str
    markerfacecolor: str
    markersize: float


@dataclass(frozen=True)
class Look:
    """How a model is drawn."""

    colour: Colour  #: Of its method, in the shade of its structure.
    place: int  #: Of the shade in the family, for shapes.
    prior: bool  #: Whether a prior stands behind it: dashed lines, filled markers.

    @property
    def hex(self) -> str:
        """The colour as #RRGGBB."""
        return hexadecimal(self.colour)

    @property
    def stroke(self) -> Literal["lines", "arrows"]:
        """How its errors are drawn in space: those of least squares as lines, all others as arrows."""
        squares = (SHADES[kind] for kind in SHADES if kind[0] == "none")
        return "lines" if any(self.colour in own.values() for own in squares) else "arrows"

    @property
    def mark(self) -> str:
        """Matplotlib's marker."""
        return MARKS[self.place % len(MARKS)]

    @property
    def face(self) -> str:
        """Colour inside its marker as #RRGGBB: filled with a prior, hollow without."""
        return self.hex if self.prior else "#FFFFFF"

    def dots(self, size: float) -> Dots:
        """As matplotlib draws them; a star is slimmer."""
        size *= 1.6 if self.mark == "*" else 1
        return {"marker": self.mark, "color": self.hex, "markerfacecolor": self.face, "markersize": size}


CHOICE = Look((10, 111, 147), MARKS.index("*"), prior=True)
"""What is chosen by default, whatever it is: dark teal, a star."""


PAPERS_MARK = "P"  #: Of GCO without a trace weight, as in the paper.


def look(structure: str, constraint: Constraint, prior: bool = False, filling: str = "none") -> Look:
    """The look of a model.

    Args:
        structure: Name of its structure.
        constraint: What its method asks of the blocks.
        prior: Whether it has a prior.
        filling: What tells the directions that no data see, where that is more than whether it has a prior;
            "paper" of GCO without a trace weight.
    """
    if constraint == "own":
        which = int(re.sub(r"\D", "", structure)[-4:] or 1) - 1
        mark = OWN_MARKS[which // len(USER_COLOURS) % len(OWN_MARKS)]
        return Look(USER_COLOURS[which % len(USER_COLOURS)], MARKS.index(mark), prior)
    told = "prior" if prior and filling == "none" else filling
    kind = _kind(structure)
    if kind == "Joints":
        return Look(JOINTS_PRIOR if prior else JOINTS, PLACES[kind], prior)
    shades = SHADES.get((constraint, told), SHADES["psd", told])
    colour = shades.get(kind) or list(shades.values())[sum(map(ord, structure)) % len(shades)]
    own = PAPERS_MARK if told == "paper" else HELD.get(constraint)
    place = MARKS.index(own) if own else PLACES.get(kind, 0)
    return Look(colour, place, prior)


@runtime_checkable
class Modelled(Protocol):
    """A row that says which model it is of."""

    structure: str
    constraint: Constraint
    prior: bool


def look_of(row: Modelled) -> Look:
    """Give the look of the model of a row; GCO without a trace weight is told by its method."""
    filling = "paper" if getattr(row, "method", "") == PAPER_GCO_METHOD else "none"
    return look(row.structure, row.constraint, row.prior, filling)


def _kind(structure: str) -> str:
    """Kind of a structure: its count for the paper's arm of six joints, whatever the arm."""
    count = re.sub(r"\D", "", structure)
    if structure in STRUCTURE_KINDS or not count:
        return STRUCTURE_KINDS.get(structure, structure)
    if count in PLACES:
        return count
    if structure.startswith("ALL"):
        return "153"
    return "56" if int(count) % FULL else "147"


def hexadecimal(colour: Colour) -> str:
    """A colour as #RRGGBB."""
    return "#" + "".join(f"{part:02X}" for part in colour[:3])
