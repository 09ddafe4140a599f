"""A doubt: what may be wrong with what was handed in, in a sentence with numbers."""

from dataclasses import dataclass

from testbench.errors import Array

LONG = 1.0  #: Length from which metres are said instead of millimetres [m].


@dataclass(frozen=True)
class Doubt:
    """What may be wrong."""

    name: str  #: A word for programs, such as "frame".
    sentence: str  #: For people: what is seen, by how much, what to check.
    #: By how many nats the readings are likelier with the mistake than without; None for what is plain.
    evidence: float | None = None


def length(metres: float) -> str:
    """A length for people: 3.42 mm, 3,420 m."""
    return f"{1e3 * metres:.3g} mm" if metres < LONG else f"{metres:,.4g} m"


def three(vector: Array, factor: float, digits: int) -> str:
    """The first three numbers of a vector, times a factor, with so many decimals."""
    return ", ".join(f"{round(factor * float(x), digits) + 0.0:.{digits}f}" for x in vector[:3])
