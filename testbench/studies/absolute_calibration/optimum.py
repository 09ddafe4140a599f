"""The least error that noise allows: what is expected of a fit that is told how large all errors are."""

from dataclasses import replace

import numpy as np

from testbench.bench.absolute_judged import true_unknowns
from testbench.bench.absolute_truth import Truth
from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.choose import GEOMETRY
from testbench.identify.absolute.evidence import Choice, Learnt, choice, solve, squares
from testbench.identify.absolute.fit import Gathered
from testbench.identify.absolute.moved import moved
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.reduced import Point, Weighting, reduce
from testbench.identify.absolute.rows import rows_of
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.metric import metric
from testbench.identify.prior import Prior, Strength
from testbench.model.joint_errors import JointErrors
from testbench.model.structure import all153

SHAPE = 0.3  #: How well compliances are known beside a common factor, standard deviation [1].
MM = 1e3


def optimum_mm(found: Gathered, truth: Truth, check: Series) -> float:
    """Expected RMS distance from the true positions of the best linear estimate, at the truth.

    It knows the standard deviations that geometry, joint errors and noise were drawn with, which orders the
    joint errors have, and compliances to SHAPE around the true ones, and has no other errors to look for.
    """
    vjm, asked = found.vjm, truth.arm.disturbances
    assert asked.geometry is not None
    orders = 0 if asked.gear is None else asked.gear.orders
    errors = JointErrors(tuple(range(1, orders + 1)))
    unknowns = unknowns_of(vjm, found.series, errors, all153(vjm.arm))
    kinds = GEOMETRY | ({"harmonics"} if orders else frozenset())
    own = choice(unknowns, kinds, metric(Prior("truth", truth.C_theta), vjm, unknowns.structure))
    x = true_unknowns(unknowns, truth)
    n = np.zeros((vjm.arm.n_joints, errors.size))
    true = moved(replace(found.state, errors=errors, n=n), own, x[own.columns])
    true = replace(true, frames=found.state.frames, mounts=found.state.mounts)
    weighting = [
        Weighting(np.ones((len(s.markers), s.rows)), np.zeros(s.rows, dtype=int)) for s in found.series
    ]
    reduced = reduce(Point(unknowns, true, Noise()), found.series, weighting)
    sizes = {
        "geometry shift": asked.geometry.position,
        "geometry turn": float(np.hypot(asked.geometry.angle, asked.sensor_offset / np.sqrt(3))),
        "harmonics": 0.0 if asked.gear is None else asked.gear.sigma,
    }
    deviation = np.full(unknowns.size, np.inf)
    for kind, columns in unknowns.groups:
        deviation[columns] = sizes[kind]
    known = Learnt(deviation, np.ones(len(reduced.kinds)))
    V = solve(own, squares(own, reduced.gram), known, Strength(SHAPE), covariance=True).covariance
    assert V is not None
    A = _lines(own, rows_of(unknowns, true, check).A)
    return MM * float(np.sqrt(3 * np.einsum("ec,cd,ed->e", A, V, A).mean()))


def _lines(own: Choice, A: Array) -> Array:
    """Equations of all positions, (e, c), compliances in the metric."""
    lines = A[:, :, own.columns].transpose(0, 1, 3, 2).reshape(-1, len(own.columns))
    assert own.elastic is not None
    return np.hstack([lines[:, : own.rigid], lines[:, own.rigid :] @ own.elastic.L])
