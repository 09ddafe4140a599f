"""Colour is a role, the same in every recording (Okabe-Ito), and never alone: width and shape go with it."""

from collections.abc import Sequence
from dataclasses import dataclass

from rerun.components import MarkerShape

from testbench.views.report import Report

Colour = tuple[int, ...]

NOMINAL, MEASURED, LOAD, NOISE = (86, 180, 233), (213, 94, 0), (204, 121, 167), (127, 127, 127)
"""Sky blue, vermillion, purple, grey."""
GHOST = (*MEASURED, 70)
TASK = (178, 156, 48)
"""Where the robot works: olive, which is neither least squares nor GCO."""

ORANGES: tuple[Colour, ...] = ((230, 159, 0), (176, 122, 72), (205, 170, 105))
"""Least squares: the best model first; shades tell the others apart."""
GREENS: tuple[Colour, ...] = (
    (0, 158, 115),
    (124, 190, 92),
    (72, 150, 160),
    (100, 140, 60),
    (150, 205, 180),
)
"""GCO, likewise."""

SHAPES = (
    MarkerShape.Circle,
    MarkerShape.Diamond,
    MarkerShape.Square,
    MarkerShape.Up,
    MarkerShape.Cross,
    MarkerShape.Plus,
)
"""Tell models of one colour apart; used again from the start beyond six models."""


@dataclass(frozen=True)
class Look:
    """How a model is drawn.

    Attributes:
        colour: Of its family, in a shade of its own.
        shape: Of its points in a plot.
        width: Of its lines in a plot [ui points].
    """

    colour: Colour
    shape: MarkerShape
    width: float


def is_gco(row: Report) -> bool:
    """Whether a model of the report was identified by GCO."""
    return str(row["method"]).startswith("GCO")


def looks(rows: Sequence[Report], first: Sequence[int]) -> list[Look]:
    """One look a model.

    Args:
        rows: The report's models.
        first: Indices of those that get the full colour of their family and a bold line.
    """
    order = sorted(range(len(rows)), key=lambda k: k not in first)
    found: dict[int, Look] = {}
    used = {True: 0, False: 0}
    for k in order:
        family = is_gco(rows[k])
        shades = GREENS if family else ORANGES
        colour = shades[used[family] % len(shades)]
        used[family] += 1
        found[k] = Look(colour, SHAPES[k % len(SHAPES)], 3.0 if k in first else 1.5)
    return [found[k] for k in range(len(rows))]
