"""The errors that a plan promises: on arms of which every link and joint gives, whatever is identified."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np

from testbench.design.forecast import BROAD, Forecast
from testbench.design.rows import Ids
from testbench.design.specification import Specification
from testbench.design.whole_arm import Fitted, fit_of
from testbench.errors import Array
from testbench.identify.intervals import CONFIDENCE
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.model.structure import Structure, all153, joints_only

UNKNOWN = 0.3  #: How well an arm's compliances are known where no prior is given [1].


def within(spec: Specification) -> float:
    """How well the arm's compliances are known, relative [1]."""
    return UNKNOWN if spec.uncertainty is None else spec.uncertainty


def fitted(spec: Specification, prior: Prior, q: Array, load: Ids) -> Fitted:
    """A specification's model after poses (poses, n) [rad, m] were measured, each under its load (poses,).

    The arms are those of the prior, each compliance within its uncertainty.
    """
    every = spec.experiment
    whole = replace(every, metric=metric(prior, every.vjm, all153(every.vjm.arm)))
    return fit_of(whole, within(spec), spec, q, load)


def joints_alone(spec: Specification, prior: Prior) -> Specification:
    """The same measured to identify joint compliances alone, by least squares."""
    return least_squares(spec, prior, joints_only(spec.experiment.vjm.arm))


def least_squares(spec: Specification, prior: Prior, structure: Structure) -> Specification:
    """The same measured to identify a structure by least squares; the prior only sets its units."""
    every = spec.experiment
    own = metric(prior, every.vjm, structure)
    return replace(spec, experiment=replace(every, metric=own), uncertainty=None)


def half_width(forecast: Forecast) -> float:
    """Of the 95 % interval of a deflection along an axis, median over poses, targets and axes [m]."""
    return float(np.median(half_widths(forecast)))


def half_widths(forecast: Forecast) -> Array:
    """Of the 95 % interval of every target's deflection along every axis, (poses, 3 m) [m]."""
    return np.asarray(NormalDist().inv_cdf((1 + CONFIDENCE) / 2) * BROAD * forecast.deviation)
