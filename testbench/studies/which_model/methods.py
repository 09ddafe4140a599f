"""The methods that are compared: the incumbent, least squares and GCO, each as it is or with a prior."""

from collections.abc import Sequence
from dataclasses import replace

from testbench.bench.campaign import MODELS, Cell, Model
from testbench.identify import completed_least_squares, gco, least_squares, with_prior
from testbench.identify.prior import Prior
from testbench.model.structure import all153

INCUMBENT = "Joints"
COMPLETED = "MLS56, PSD of equal fit"


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
        Model("ALL153", all153(cell.arm), gco),
    ]


def filled(models: Sequence[Model], prior: Prior) -> list[Model]:
    """Methods with a prior."""
    return [replace(m, name=f"{m.name} + prior", estimator=with_prior(m.estimator, prior)) for m in models]
