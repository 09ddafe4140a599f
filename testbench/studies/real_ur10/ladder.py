"""The ladder: models of an arm from geometry alone to all that cross-validation keeps."""

from dataclasses import dataclass

from testbench.identify.absolute.fit import Options
from testbench.identify.prior import Strength

SPRINGS, ERRORS, LINKS = "joint springs", "joint errors", "links"
WEAK = Strength(5.0)
"""Compliances five times as uncertain as they are large: hardly a prior."""


@dataclass(frozen=True)
class Model:
    """One model of the ladder."""

    name: str
    words: str  #: What it is.
    options: Options  #: What it has.


def _model(name: str, words: str, *on: str, **more: object) -> Model:
    return Model(name, words, Options(only=frozenset(on), **more))  # type: ignore[arg-type]  # as Options has them


GEOMETRY = _model("geometry", "30 errors of geometry, links and joints rigid")
JOINTS = _model(
    "+ joint springs", "geometry and a spring in every joint, what good calibrations stop at", SPRINGS
)
LINKS_LS = _model(
    "+ links, LS",
    "6x6 links, least squares, hardly a prior",
    SPRINGS,
    LINKS,
    constraint="none",
    strength=WEAK,
)
LINKS_GCO = _model("+ links, GCO", "the same with every block a Gramian", SPRINGS, LINKS, strength=WEAK)
LINKS_PRIOR = _model("+ links, GCO + prior", "the same with a prior learnt from the readings", SPRINGS, LINKS)
WAVES = _model("+ joint errors", "joint springs and periodic errors of every joint", SPRINGS, ERRORS)
ALL = _model("+ joint errors + links", "these and 6x6 links, GCO with a learnt prior", SPRINGS, ERRORS, LINKS)
CHOSEN = Model("chosen", "what cross-validation keeps, gear ratio, play and stiffening tried too", Options())

LADDER = (GEOMETRY, JOINTS, LINKS_LS, LINKS_GCO, LINKS_PRIOR, WAVES, ALL, CHOSEN)
QUICK = (GEOMETRY, JOINTS, WAVES)
TWO = (JOINTS, WAVES)
"""With and without joint errors."""
