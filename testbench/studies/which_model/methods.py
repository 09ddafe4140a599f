"""The methods that are compared: the incumbent, least squares and GCO, each as it is or with a prior."""

from dataclasses import replace

from testbench.bench.campaign import MODELS, Cell, Model
from testbench.bench.default import INCUMBENT
from testbench.identify import completed_least_squares, least_squares

CHOSEN = "default"  #: What `bench.default` chooses from the readings.
COMPLETED = "MLS56, PSD of equal fit"
COVERED = (CHOSEN, INCUMBENT, "MGCO56 + prior", "ALL153 + prior")
"""Whose intervals are judged; those of joints alone show what noise alone would promise."""


def without_prior(cell: Cell) -> list[Model]:
    """Methods that know of no prior."""
    mls56 = MODELS["MLS56"](cell)
    completed = replace(mls56, name=COMPLETED, estimator=completed_least_squares)
    return [MODELS[INCUMBENT](cell), mls56, completed, MODELS["MGCO56"](cell), MODELS["MGCO68"](cell)]


def to_fill(cell: Cell) -> list[Model]:
    """Methods that are fitted with a prior, learnt from the readings."""
    mgco56 = MODELS["MGCO56"](cell)
    return [
        MODELS[INCUMBENT](cell),
        replace(mgco56, name="MLS56", estimator=least_squares),
        mgco56,
        MODELS["MGCO68"](cell),
        MODELS["ALL153"](cell),
    ]
