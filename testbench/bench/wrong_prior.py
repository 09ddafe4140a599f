"""Priors that are wrong on purpose, and models that are fitted with them."""

from collections.abc import Sequence
from dataclasses import replace

from testbench.bench.campaign import Cell, Model, stream
from testbench.identify import with_prior
from testbench.identify.prior import Prior, Strength, cad_prior, distorted

SCALE, SHAPE, UNCERTAINTY = 2.0, 0.3, 0.3
"""How wrong a prior is, by a common factor and axis by axis, and how firmly it is believed."""


def wrong_prior(cell: Cell, seed: int, scale: float = SCALE) -> Prior:
    """The CAD prior, `scale` times too soft and SHAPE wrong axis by axis; another one for every seed."""
    return distorted(cad_prior(cell.arm), scale=scale, shape=SHAPE, rng=stream(seed, 5))


def with_wrong_prior(cell: Cell, models: Sequence[Model], names: Sequence[str], seed: int) -> list[Model]:
    """Models without a prior, then those of these names with one that is wrong; the seed is of its errors."""
    prior, believed = wrong_prior(cell, seed), Strength(UNCERTAINTY)
    filled = [
        replace(m, name=f"{m.name} + prior", estimator=with_prior(m.estimator, prior, believed))
        for m in models
        if m.name in names
    ]
    return [*models, *filled]
