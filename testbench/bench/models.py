"""Models by name: a structure with the method that identifies it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from testbench.bench.campaign import Cell
from testbench.errors import BenchError
from testbench.identify import Estimator, gco, least_squares
from testbench.identify.reduction import non_redundant
from testbench.model.structure import (
    Structure,
    all153,
    joints_only,
    mgco47,
    mgco68,
    mgco69,
    mgco147,
    template56,
)


@dataclass(frozen=True)
class Model:
    """A named structure with the method that identifies it."""

    name: str  #: As in the paper, such as MGCO68.
    structure: Structure  #: The unknowns.
    estimator: Estimator  #: A `Method`, or a function of your own.


def _mls32(cell: Cell) -> Model:
    kept = non_redundant(cell.vjm, template56(cell.arm), name="MLS32")
    return Model("MLS32", kept, least_squares)


MODELS: dict[str, Callable[[Cell], Model]] = {
    "Joints": lambda cell: Model("Joints", joints_only(cell.arm), least_squares),
    "MLS32": _mls32,
    "MLS56": lambda cell: Model("MLS56", template56(cell.arm, name="MLS56"), least_squares),
    "MGCO47": lambda cell: Model("MGCO47", mgco47(cell.arm), gco),
    "MGCO56": lambda cell: Model("MGCO56", template56(cell.arm), gco),
    "MGCO68": lambda cell: Model("MGCO68", mgco68(cell.arm), gco),
    "MGCO69": lambda cell: Model("MGCO69", mgco69(cell.arm), gco),
    "MGCO147": lambda cell: Model("MGCO147", mgco147(cell.arm), gco),
    "ALL153": lambda cell: Model("ALL153", all153(cell.arm), gco),
}
"""Models by name, the paper's, "Joints" and "ALL153": MODELS["MGCO56"](cell) has structure and method."""

SECTION_6 = ("MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""The models of section 6, in the paper's order."""


def named_models(cell: Cell, names: Sequence[str] = SECTION_6) -> list[Model]:
    """Models of the paper by name, in any case.

    Raises:
        BenchError: When there is no such model, or the arm has too few links for it.
    """
    return [MODELS[right_name(name)](cell) for name in names]


def right_name(name: str) -> str:
    """The name of a model as it is written, from one in any case.

    Raises:
        BenchError: When there is no such model.
    """
    for known in MODELS:
        if known.casefold() == name.casefold():
            return known
    raise BenchError(f"no model {name!r}; models are {', '.join(MODELS)}")
