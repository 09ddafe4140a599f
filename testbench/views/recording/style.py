"""How roles and models look in a recording: colours of `views.colours`, with shapes and widths."""

from dataclasses import dataclass

from rerun.components import MarkerShape

from testbench.views.colours import GREENS, GREY, LOAD, MEASURED, NOMINAL, ORANGES, TASK, Colour, Look

__all__ = ["GHOST", "GREENS", "LOAD", "MEASURED", "NOISE", "NOMINAL", "ORANGES", "SHAPES", "TASK", "Colour"]

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
TINT = 0.45  #: Share of white in the colour of a model with a prior: a plot's legend shows colours only.


@dataclass(frozen=True)
class Drawn:
    """How a model is drawn."""

    colour: Colour  #: Of its family, in the shade of its structure.
    shape: MarkerShape  #: Of its points in a plot.
    width: float  #: Of its lines in a plot [ui points].


def drawn(look: Look, bold: bool) -> Drawn:
    """A look in a recording; bold is what to look at first."""
    shape = MarkerShape.Cross if look.prior else SHAPES[look.place % len(SHAPES)]
    colour = tuple(round(c + TINT * (255 - c)) for c in look.colour) if look.prior else look.colour
    return Drawn(colour, shape, 3.0 if bold else 1.5)
