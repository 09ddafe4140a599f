"""One colour and one mark a solver: the conic program green, the others not; all minimise the same F_M."""

from testbench.views.colours import GREENS, LOAD, MEASURED, NOMINAL, Colour

COLOURS: dict[str, Colour] = {
    "a": MEASURED,
    "a'": (238, 152, 104),
    "b": NOMINAL,
    "b'": (130, 140, 200),
    "c": LOAD,
    "d": GREENS[0],
    "e": (190, 160, 60),
}
MARKS = {"a": "o", "a'": "v", "b": "^", "b'": "P", "c": "s", "d": "*", "e": "D"}
