"""The methods that are compared: the incumbent, least squares and GCO, each as it is or with a prior."""

from dataclasses import replace

from testbench.bench.baselines import JOINTS, equal_fit
from testbench.bench.campaign import Cell
from testbench.bench.models import MODELS, Model, named_models
from testbench.identify import least_squares

CHOSEN = "default"  #: What `bench.default` chooses from the readings.
COVERED = (CHOSEN, JOINTS, "MGCO56 + prior", "ALL153 + prior")
"""Whose intervals are judged; those of joints alone show what noise alone would promise."""


def without_prior(cell: Cell) -> list[Model]:
    """Methods that know of no prior."""
    joints, mls56, *others = named_models(cell, (JOINTS, "MLS56", "MGCO56", "MGCO68"))
    return [joints, mls56, equal_fit(cell), *others]


def to_fill(cell: Cell) -> list[Model]:
    """Methods that are fitted with a prior, learnt from the readings."""
    mgco56 = MODELS["MGCO56"](cell)
    return [
        MODELS[JOINTS](cell),
        replace(mgco56, name="MLS56", estimator=least_squares),
        mgco56,
        MODELS["MGCO68"](cell),
        MODELS["ALL153"](cell),
    ]
