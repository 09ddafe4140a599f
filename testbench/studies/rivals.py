"""Rivals of the default in every study: the default without its cone, and restrained least squares."""

from collections.abc import Sequence
from dataclasses import replace

from testbench.identify import gco, least_squares, paper_gco
from testbench.model.structure import all153, template56
from testbench.studies.estimators.shrunk import clipped, ridge
from testbench.workflows.cell import Cell
from testbench.workflows.model_selection import FILLED
from testbench.workflows.models import WITHOUT_CONE, Model, equal_fit, named_models

IN_PAPER = " (paper)"  #: Behind the name of a model that GCO identifies without a trace weight.
LEAST_SQUARES = "MLS56"
#: Unknowns, prior and evidence of the default; what it lacks is the cone.
DEFAULT_WITHOUT_CONE = f"{WITHOUT_CONE}{FILLED}"


def plain_models(cell: Cell, names: Sequence[str]) -> list[Model]:
    """Models without a prior; behind MLS56 what holds it down: equal fits, shrinking, clipping afterwards."""
    models, behind = named_models(cell, names), names.index(LEAST_SQUARES) + 1
    beams = template56(cell.arm, name=LEAST_SQUARES)
    held = [equal_fit(cell), Model("Ridge", beams, ridge), Model("Clipped LS", beams, clipped)]
    return [*models[:behind], *held, *models[behind:]]


def as_in_paper(models: Sequence[Model]) -> list[Model]:
    """Those that GCO identifies without a prior, by the paper's GCO, which has no trace weight; named so."""
    own = [m for m in models if m.estimator == gco]
    return [Model(f"{m.name}{IN_PAPER}", m.structure, paper_gco) for m in own]


def without_cone(cell: Cell) -> Model:
    """The unknowns of the default, to be given its prior."""
    return Model(WITHOUT_CONE, replace(all153(cell.arm), name=WITHOUT_CONE), least_squares)
