"""One colour and one mark a solver: the conic program green, the others not; all minimise the same F_M."""

from testbench.views.colours import GCO, SERIES, Colour

COLOURS: dict[str, Colour] = {
    "a": SERIES[3],
    "a'": SERIES[2],
    "b": SERIES[1],
    "b'": SERIES[5],
    "c": SERIES[4],
    "d": GCO,
    "e": SERIES[6],
}
MARKS = {"a": "o", "a'": "v", "b": "^", "b'": "P", "c": "s", "d": "*", "e": "D"}
