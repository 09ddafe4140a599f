"""How roles and models look in a recording: colours of `views.colours`, with shapes and widths."""

from dataclasses import dataclass

from rerun.components import MarkerShape

from testbench.views.colours import GCO, GREY, LEAST_SQUARES, LOAD, MEASURED, NOMINAL, TASK, Colour, Look

__all__ = [
    "GCO",
    "GHOST",
    "LEAST_SQUARES",
    "LOAD",
    "MEASURED",
    "NOISE",
    "NOMINAL",
    "SHAPES",
    "TASK",
    "Colour",
]

NOISE = GREY
GHOST = (*MEASURED, 70)

SHAPES = (
    MarkerShape.Circle,
    MarkerShape.Square,
    MarkerShape.Diamond,
    MarkerShape.Up,
    MarkerShape.Down,
    MarkerShape.Plus,
)
"""One a shade of a family; with a prior a cross."""


@dataclass(frozen=True)
class Drawn:
    """How a model is drawn."""

    colour: Colour  #: Its own: a plot's legend shows colours only.
    shape: MarkerShape  #: Of its points in a plot.


def drawn(look: Look) -> Drawn:
    """A look in a recording."""
    shape = MarkerShape.Cross if look.prior else SHAPES[look.place % len(SHAPES)]
    return Drawn(look.colour, shape)
