"""Uncertainty of estimates and calibrations: the posterior distribution of their parameters.

The covariance (M^T M)^+ is that of weighted least squares, Eq. (14)-(15). M stacks the observation matrix,
each row divided by the standard deviation of its reading, and the whitened rows of the prior. A direction
that M does not determine has an infinite standard deviation. GCO has the same distribution if no link
compliance is at the boundary of the positive semi-definite cone.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from statistics import NormalDist
from typing import Protocol, runtime_checkable

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, select_rows
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, check_array, check_type
from testbench.identify.absolute.align import Noise
from testbench.identify.absolute.state import ArmState, Unknowns, nominal_state
from testbench.identify.estimate import Estimate, ModelAverage, sensitivity_units
from testbench.identify.prior import WeightedPrior, prior_rows
from testbench.identify.regression import RANK_TOLERANCE, embed_parameters
from testbench.model.laws import set_load_history, vjm_for_structure
from testbench.model.load import (
    BodyMasses,
    first_order_deflection,
    nonlinear_deflection,
    one_step_theta,
)
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, evaluate_chain, marker_positions, observation_matrix

# --- Uncertainty of everything that is linear in the unknowns -----------------------------------------------

MAX_UNOBSERVABLE_SHARE = 1e-8
"""Largest share of a linear functional along unobservable directions with which it still counts as determined
[1]; rounding is 1e-11."""
#: Distance between the estimate and the optimum without the positive semi-definite constraint from which the
#: constraint counts as active [standard deviations].
MIN_BINDING_CONE_DISTANCE = 0.1
CONFIDENCE = 0.95  #: Default probability that an interval contains the true value [1].
COVARIANCE_RIDGE, MIN_COVARIANCE_RIDGE = 1e-12, 1e-100
"""Ridge added to a covariance before it is solved, relative to its mean diagonal, and the least ridge."""
DEFLECTIONS_PER_BATCH = 600  #: Number of deflections whose intervals are computed at once; it limits memory.
SECOND_ORDER_FACTOR = 2.0
"""Factor on the second-order deflection in an interval [1]: once for the prediction, once for its effect on
the identified parameters. On an arm that deflects by 9 to 41 mm (`arm_6r`, 18 full poses, non-linear true
arms of the family, seeds 1 to 5) 95 % intervals cover 68 % without this term and 97 % with it."""
PRIOR_STUDENT_DOF = 4.0
"""Degrees of freedom of the Student distribution of prediction errors that come from the prior.

Errors of priors have heavier tails than a normal distribution; errors of readings have not. Over fourteen
kinds of true arms (`plant.true_arms`, seeds 740001 to 740017, 8 poses, wrong priors) 90, 95 and 98 % of
errors are within 1.6, 2.0 and 2.3 standard deviations of the noise plus 1.8, 2.4 and 3.2 of the prior; with
cast links these are 2.5, 3.2 and 4.0. Student's distribution with 4 degrees of freedom has 2.1, 2.8 and 3.7.
"""


@dataclass(frozen=True, repr=False)
class Intervals(Displayed):
    """Hold intervals of predictions, such as deflections along world x, y and z, (runs, m, 3) [m]."""

    centre: Array  #: The predictions, of any shape.
    lower: Array  #: Lower ends; -inf where the readings determine nothing.
    upper: Array  #: Upper ends; inf where the readings determine nothing.
    confidence: float  #: Probability that one interval contains the truth, 0.95 by default [1].
    #: Whether the positive semi-definite constraint is active; the intervals are then not exact.
    on_cone_boundary: bool


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Displayed):
    """Hold the normal distribution of n unknowns x: their mean and covariance.

    A linear functional a, such as a row of the observation matrix, has the mean a @ x and the standard
    deviation |R a|, where R^T R = (M^T M)^-1 is the covariance and M holds the whitened rows of readings and
    prior. The uncertainty that comes from a learnt prior has Student's distribution; it is added to that of
    the noise in quadrature. Units are those of the unknowns, such as [m/N, rad/(N m), rad/N] of compliances.
    """

    mean: Array  #: Mean of the unknowns: their estimate, (n,).
    covariance_root: Array  #: R, with the covariance R^T R in observable directions, (r, n).
    #: Directions of x along which no reading changes, one per row, (f, n); their variance is infinite.
    unobservable_directions: Array
    typical_sizes: Array  #: Typical size of each unknown, to tell its values from rounding errors, (n,).
    #: Degrees of freedom of the Student distribution of the prior's errors; infinite for a normal one.
    student_dof: float = math.inf
    n_prior_rows: int = 0  #: Number of rows of R, the last ones, that are uncertainty from the prior.
    #: Distance between the estimate and the optimum without the positive semi-definite constraint [standard
    #: deviations].
    cone_distance: float = 0.0
    on_cone_boundary: bool = False  #: Whether the positive semi-definite constraint is active.

    @classmethod
    def from_covariance_root(cls, mean: Array, covariance_root: Array) -> "Posterior":
        """Make a posterior from a mean and a root R of the covariance R^T R; all directions are observable.

        Args:
            mean: Mean of the unknowns, (n,).
            covariance_root: R, (r, n).
        """
        return cls(mean, covariance_root, np.zeros((0, len(mean))), np.ones(len(mean)))

    @classmethod
    def from_whitened_rows(cls, M: Array, L: Array, mean: Array) -> "Posterior":
        """Make the posterior of unknowns x = L z, with the covariance L (M^T M)^+ L^T.

        Mathematics: `int-1`.

        Args:
            M: Observation matrix of z, each row over the standard deviation of its reading, (e, n) [1].
            L: Unknowns x per unit of z, (n, n).
            mean: Mean of the unknowns, (n,).

        Returns:
            The posterior; directions that M does not observe have an infinite variance.
        """
        back, unobservable = _inverse(M)
        return cls(mean, back @ L.T, unobservable @ L.T, np.linalg.norm(L, axis=1))

    def standard_deviations(self, functionals: Array) -> Array:
        """Compute the standard deviations |R a| of linear functionals a; R^T R is the covariance of x.

        Mathematics: `int-2`.

        Args:
            functionals: Rows a, such as those of an observation matrix, (k, n).

        Returns:
            Standard deviations, (k,), in the unit of a @ x; infinite where the data do not determine a @ x.

        Raises:
            BenchError: When a functional has another length or is not finite.
        """
        return self._deviations(functionals)[0]

    def _deviations(self, functionals: Array) -> tuple[Array, Array]:
        """Compute standard deviations, and the part of them that is due to the prior, (k,) each."""
        a = check_array(functionals, (None, len(self.mean)), "functionals [m per unit of pi]")
        white = a @ self.covariance_root.T
        from_prior = white[:, len(self.covariance_root) - self.n_prior_rows :]
        total, prior = (np.sqrt(np.vecdot(part, part)) for part in (white, from_prior))
        if not len(self.unobservable_directions):
            return total, prior
        size = np.linalg.norm(a * self.typical_sizes, axis=1)
        along = np.linalg.norm(a @ self.unobservable_directions.T, axis=1)
        return np.where(along > MAX_UNOBSERVABLE_SHARE * size, np.inf, total), prior

    def half_widths(self, functionals: Array, confidence: float = CONFIDENCE) -> Array:
        """Compute half widths of confidence intervals of linear functionals a of the unknowns.

        Noise and prior are added in quadrature.

        Mathematics: `int-6`.

        Args:
            functionals: Rows a, such as those of an observation matrix, (k, n).
            confidence: Probability that one interval contains the true a @ x [1].

        Returns:
            Half widths, (k,), in the unit of a @ x; infinite where the data do not determine a @ x.

        Raises:
            BenchError: When the confidence is outside (0, 1) or a functional has another length.
        """
        check_confidence(confidence)
        whole, prior = self._deviations(functionals)
        normal, student = (
            student_quantile(student_dof, (1 + confidence) / 2)
            for student_dof in (math.inf, self.student_dof)
        )
        return np.asarray(np.hypot(normal * whole, math.sqrt(max(0, student**2 - normal**2)) * prior))

    def intervals(self, functionals: Array, confidence: float = CONFIDENCE) -> Intervals:
        """Compute confidence intervals of linear functionals a of the unknowns, around a @ x.

        Args:
            functionals: Rows a, such as those of an observation matrix, (k, n).
            confidence: Probability that one interval contains the true a @ x [1].

        Returns:
            Centre, lower and upper ends, (k,) each, in the unit of a @ x.

        Raises:
            BenchError: When the confidence is outside (0, 1) or a functional has another length.
        """
        half = self.half_widths(functionals, confidence)
        centre = functionals @ self.mean
        return Intervals(centre, centre - half, centre + half, confidence, self.on_cone_boundary)

    def covariance(self, functionals: Array) -> Array:
        """Compute the covariances A K A^T of groups of linear functionals of x, the rows of A.

        K is the covariance of x. The data must determine all functionals.

        Args:
            functionals: A, rows of k functionals per group, (..., k, n).

        Returns:
            Covariance matrices, (..., k, k), in the squared unit of A @ x.
        """
        white = functionals @ self.covariance_root.T
        return np.asarray(white @ white.swapaxes(-1, -2))


def intervals(vjm: Vjm, estimate: Estimate, data: Dataset, confidence: float = CONFIDENCE) -> Intervals:
    """Compute confidence intervals of the deflections of markers that an estimate predicts.

    The half width is the root of the sum of three squares: the noise, the prior, and `SECOND_ORDER_FACTOR`
    times the deflection that the linear model omits, see `second_order_deflection`.

    Mathematics: `int-8`.

    Args:
        vjm: The arm's virtual joint model.
        estimate: The identified compliances. Of GCO without a prior, intervals are exact only if the positive
            semi-definite constraint is not active.
        data: Poses, loads and markers; its readings are not used.
        confidence: Probability that one interval contains the true deflection [1].

    Returns:
        Intervals in base axes of every marker in every run, (runs, m, 3) [m].

    Raises:
        BenchError: When an argument has another type, or the confidence is outside (0, 1).
    """
    check_type(vjm, Vjm, "vjm")
    check_type(estimate, Estimate, "estimate")
    check_type(data, Dataset, "data")
    vjm = vjm_for_structure(vjm, estimate.structure)
    posterior, points = posterior_of_estimate(estimate), marker_positions(vjm, data.markers)
    together, ends = max(1, DEFLECTIONS_PER_BATCH // len(points)), []
    for first in range(0, data.n_runs, together):
        block = select_rows(data, np.arange(first, min(first + together, data.n_runs)))
        where = evaluate_chain(set_load_history(vjm, block.unloaded_after_load), block.q)
        rows = observation_matrix(where, estimate.structure, block.wrench, block.point, points)
        bounds = posterior.intervals(rows.reshape(-1, estimate.structure.n_parameters), confidence)
        centre, upper = (end.reshape(rows.shape[:3]) for end in (bounds.centre, bounds.upper))
        # Half widths from noise and prior, and from terms that the linear model omits, in quadrature.
        half = np.hypot(
            upper - centre, SECOND_ORDER_FACTOR * second_order_deflection(vjm, estimate.C_theta, block)
        )
        ends.append((centre, centre - half, centre + half))
    centre, lower, upper = map(np.concatenate, zip(*ends, strict=True))
    return Intervals(centre, lower, upper, confidence, posterior.on_cone_boundary)


def second_order_deflection(vjm: Vjm, C_theta: Array, data: Dataset) -> Array:
    """Compute the second-order deflection that the linear model of Eq. (6) omits; own weight is left out.

    It is one step of the fixed-point iteration of Eq. (7): the load acts on the arm that has the linear
    deflection. One step exists for any C_theta, also where the iteration has no limit.

    Mathematics: `int-7`.

    Args:
        vjm: The arm's virtual joint model.
        C_theta: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        data: Poses, loads and markers; its readings are not used.

    Returns:
        Deflection of every marker after the step minus its linear deflection, base axes, (runs, m, 3) [m].
    """
    points, where = marker_positions(vjm, data.markers), evaluate_chain(vjm, data.q)
    theta = one_step_theta(where, C_theta, data.wrench, data.point)
    again = one_step_theta(evaluate_chain(vjm, data.q, theta), C_theta, data.wrench, data.point)
    return nonlinear_deflection(vjm, data.q, again, points) - first_order_deflection(where, theta, points)


@lru_cache(maxsize=16)
def posterior_of_estimate(estimate: Estimate) -> Posterior:
    """Compute mean and covariance of an estimate's parameters, Eq. (14)-(15); rows of a prior count as data.

    The last results are cached, because intervals, predictions, figures and the model's folder need the same.

    Mathematics: `int-1`, `int-3`, `int-5`.

    Args:
        estimate: The identified compliances, from any method.

    Returns:
        The posterior of the parameters pi [m/N, rad/(N m), rad/N]; a mixture where the estimate averages
        models.
    """
    if estimate.averaged_models is not None:
        return _averaged(estimate, estimate.averaged_models)
    regression, weighted_prior = estimate.regression, estimate.weighted_prior
    # Equations of readings and prior in scaled parameters z, pi = L z, weighted to unit variance.
    L = np.diag(sensitivity_units(regression)) if weighted_prior is None else weighted_prior.scaling.L
    blocks = [math.sqrt(t.n_equations / 3) * np.c_[t.R @ L, t.z] for t in regression.terms]
    if weighted_prior is not None:
        blocks.append(np.column_stack(prior_rows(weighted_prior.scaling, weighted_prior.uncertainty)))
    x, rows = np.r_[np.linalg.solve(L, estimate.pi), -1.0], [block[:, :-1] for block in blocks]
    # Root of their covariance; with a learnt prior noise and prior have separate rows.
    back, unobservable = _inverse(np.vstack(rows))
    pull = _distance_without_cone(estimate, rows, back, [block @ x for block in blocks])
    learnt = weighted_prior is not None and weighted_prior.hyperparameter_effect is not None
    if weighted_prior is not None and learnt:
        root, heavy = _noise_and_prior_roots(rows, back, weighted_prior, L)
    else:
        root, heavy = (1.0 if weighted_prior is None else weighted_prior.noise_factor) * back @ L.T, 0
    if regression.pose_variation is not None:  # links vary from pose to pose, also in new poses
        root = np.vstack([regression.pose_variation, root])
    return Posterior(
        mean=estimate.pi,
        covariance_root=root,
        unobservable_directions=unobservable @ L.T,
        typical_sizes=np.linalg.norm(L, axis=1),
        student_dof=PRIOR_STUDENT_DOF if learnt else math.inf,
        n_prior_rows=heavy,
        cone_distance=pull,
        on_cone_boundary=estimate.conservative and pull > MIN_BINDING_CONE_DISTANCE,
    )


def _inverse(M: Array) -> tuple[Array, Array]:
    """Compute a root of (M^T M)^+, (r, n), and the directions that rows M do not observe, (n - r, n)."""
    _, s, Vt = np.linalg.svd(np.linalg.qr(M, mode="r"))
    r = int((s > RANK_TOLERANCE * s[0]).sum()) if s[0] > 0 else 0
    return Vt[:r] / s[:r, None], Vt[r:]


def conditional_covariance(covariance: Array, variables: Ids, known_variables: Ids) -> Array:
    """Compute the covariance of some variables if others are known exactly: K_oo - K_ok K_kk^-1 K_ko.

    Args:
        covariance: Covariance of all variables, (n, n).
        variables: Indices o of the variables, (o,).
        known_variables: Indices k of the variables that are known exactly, (k,).

    Returns:
        Conditional covariance, (o, o), in the unit of K.
    """
    C, X = (
        covariance[np.ix_(known_variables, known_variables)],
        covariance[np.ix_(variables, known_variables)],
    )
    ridge = (COVARIANCE_RIDGE * np.trace(C) / len(C) + MIN_COVARIANCE_RIDGE) * np.eye(len(C))
    return np.asarray(covariance[np.ix_(variables, variables)] - X @ np.linalg.solve(C + ridge, X.T))


def _averaged(estimate: Estimate, average: ModelAverage) -> Posterior:
    """Mix the posteriors of averaged models by probability, each widened by its distance from the mean."""
    parts = [
        (p, _embed(posterior_of_estimate(model), model.structure, estimate.structure))
        for p, model in average.interval_models
    ]
    first = parts[0][1]
    if len(parts) == 1 and np.array_equal(first.mean, estimate.pi):
        return first
    noise, heavy = [], []
    for p, posterior in parts:
        rows = np.vstack([posterior.covariance_root, estimate.pi - posterior.mean])
        n_noise_rows = len(posterior.covariance_root) - posterior.n_prior_rows
        noise.append(math.sqrt(p) * rows[:n_noise_rows])
        heavy.append(math.sqrt(p) * rows[n_noise_rows:])
    R, prior = (np.linalg.qr(np.vstack(rows), mode="r") for rows in (noise, heavy))
    return replace(first, mean=estimate.pi, covariance_root=np.vstack([R, prior]), n_prior_rows=len(prior))


def _embed(posterior: Posterior, structure: Structure, widest: Structure) -> Posterior:
    """Embed a posterior in the unknowns of a wider structure; all others are zero."""
    x, root, unobservable, scale = (
        embed_parameters(numbers, structure, widest)
        for numbers in (
            posterior.mean,
            posterior.covariance_root,
            posterior.unobservable_directions,
            posterior.typical_sizes,
        )
    )
    return replace(
        posterior, mean=x, covariance_root=root, unobservable_directions=unobservable, typical_sizes=scale
    )


def _noise_and_prior_roots(
    rows: list[Array], back: Array, weighted_prior: WeightedPrior, L: Array
) -> tuple[Array, int]:
    """Compute a root of the covariance, and the number of its rows, the last ones, that are from the prior.

    With M the equations A of the readings above those B of the prior, the covariance is (M^T M)^-1 (A^T A +
    B^T B) (M^T M)^-1: the effects of noise and of errors of the prior on the estimate. Learnt sizes of these
    errors are uncertain: by the law of total variance their mean squares count, which are B times
    `uncertainty_factors`. Changes of the estimate with the learnt sizes are additional rows.
    """
    assert weighted_prior.hyperparameter_effect is not None
    assert weighted_prior.uncertainty_factors is not None
    *readings, prior = (
        row @ back.T for row in [*rows[:-1], weighted_prior.uncertainty_factors[:, None] * rows[-1]]
    )
    noise = np.linalg.qr(np.vstack(readings), mode="r") @ back
    open_ = np.linalg.qr(prior, mode="r") @ back
    root = np.vstack(
        [
            weighted_prior.noise_factor * noise @ L.T,
            weighted_prior.noise_factor * open_ @ L.T,
            weighted_prior.hyperparameter_effect,
        ]
    )
    return root, len(open_) + len(weighted_prior.hyperparameter_effect)


def _distance_without_cone(
    estimate: Estimate, rows: list[Array], back: Array, residuals: list[Array]
) -> float:
    """Compute the length of the step to the nearer optimum without the cone, of Eq. (14) or Eq. (19)."""
    steps = [back @ (B.T @ e) for B, e in zip(rows, residuals, strict=True)]
    pull = float(np.linalg.norm(sum(steps)))
    if estimate.weighted_prior is None and len(steps) > 1:  # F_M weights its terms by their residuals
        terms = zip(steps, residuals, estimate.regression.terms, strict=True)
        tilted = [g / (math.sqrt((e @ e) / t.n_equations + t.unexplained / 3) or 1.0) for g, e, t in terms]
        pull = min(pull, float(np.linalg.norm(sum(tilted))))
    return pull


def student_quantile(dof: float, probability: float) -> float:
    """Compute a quantile of Student's t distribution, or of the standard normal one.

    Args:
        dof: Degrees of freedom; infinite for the normal distribution.
        probability: Probability p, in (0, 1) [1].

    Returns:
        The value that the variable exceeds with the probability 1 - p [1].
    """
    if math.isinf(dof):
        return NormalDist().inv_cdf(probability)
    if dof == 4:  # as `PRIOR_STUDENT_DOF`: a closed form (Shaw 2006), and scipy takes long to import
        root = 2 * math.sqrt(probability * (1 - probability))
        return math.copysign(2 * math.sqrt(math.cos(math.acos(root) / 3) / root - 1), probability - 0.5)
    from scipy.special import stdtrit

    return float(stdtrit(dof, probability))


def check_confidence(confidence: float) -> None:
    """Check that a confidence [1] is between 0 and 1.

    Raises:
        BenchError: If it is not.
    """
    if not 0 < confidence < 1:
        raise BenchError(f"confidence: expected a number between 0 and 1, got {confidence}")


# --- An identified arm: its state, the posterior of its unknowns, and its origin ----------------------------


@dataclass(frozen=True)
class ModelOrigin:
    """Hold the origin of a model: method, files of readings, warnings and largest load."""

    method: str  #: Name of the identification method.
    #: SHA-256 of every file of readings, by file name.
    file_hashes: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()  #: Warnings about the model, as sentences.
    largest_force: float | None = None  #: Largest force in the readings [N]; None if unknown.
    #: Largest moment about the tool's origin in the readings [N m]; None if unknown.
    largest_moment: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class ArmModel:
    """Hold an identified arm with the posterior of its parameters.

    A model of deflections has identified compliances. A model of absolute readings also has identified
    geometry and joint errors.
    """

    #: Arm with virtual joints theta = theta_0 + C_theta u + Phi(q) n, with geometric errors theta_0, loads u
    #: (own weight included), joint errors Phi n.
    state: ArmState
    structure: Structure  #: Structure of the uncertain compliances.
    uncertain_columns: Ids  #: Columns of `unknowns` that are uncertain, (c,).
    posterior: Posterior  #: Posterior of the c uncertain unknowns.
    origin: ModelOrigin  #: Method, files of readings, warnings and largest load.
    #: Noise of absolute readings; None where geometry and joint errors were not identified.
    noise: Noise | None = None

    def __repr__(self) -> str:
        return (
            f"ArmModel(arm={self.arm.name}, method={self.origin.method}, structure={self.structure.name}, "
            f"unknowns={len(self.uncertain_columns)}, absolute={self.is_absolute})"
        )

    @property
    def vjm(self) -> Vjm:
        """Return the virtual joint model of the nominal arm."""
        return self.state.vjm

    @property
    def arm(self) -> Arm:
        """Return the description of the nominal arm: kinematics, nominal stiffness and limits."""
        return self.vjm.arm

    @property
    def is_absolute(self) -> bool:
        """Tell whether geometry and joint errors were identified in addition to compliances."""
        return self.noise is not None

    @property
    def position_scatter(self) -> float:
        """Return the standard deviation of position errors that the model leaves unexplained [m].

        It is 0 for a model of compliances only.
        """
        return 0.0 if self.noise is None else self.noise.position_model_error * float(self.noise.factor[0])

    @property
    def unknowns(self) -> Unknowns:
        """Return the columns of all unknowns: geometry, then joint errors, then compliances."""
        return Unknowns(self.vjm, (), {}, self.state.error_terms, self.structure)


def model_of_estimate(vjm: Vjm, estimate: Estimate, body_masses: BodyMasses) -> ArmModel:
    """Make the model of an arm of nominal geometry with estimated compliances.

    Args:
        vjm: The arm's virtual joint model.
        estimate: The identified compliances, from any method.
        body_masses: Masses and centres of mass of the links, such as `read_body_masses` returns.
    """
    state = elastic_state(vjm_for_structure(vjm, estimate.structure), estimate.C_theta, body_masses)
    return model_of_compliances(
        state, estimate.structure, posterior_of_estimate(estimate), ModelOrigin(estimate.method)
    )


def elastic_state(vjm: Vjm, C_theta: Array, body_masses: BodyMasses) -> ArmState:
    """Make the state of an arm of nominal geometry with given compliances.

    Args:
        vjm: The arm's virtual joint model.
        C_theta: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        body_masses: Masses and centres of mass of the links.
    """
    return replace(nominal_state(vjm, body_masses, np.zeros(vjm.arm.n_joints)), C_theta=C_theta)


def model_of_compliances(
    arm_state: ArmState, structure: Structure, posterior: Posterior, origin: ModelOrigin
) -> ArmModel:
    """Make an arm model of which only the compliances are uncertain; its geometry counts as exact.

    Args:
        arm_state: Geometry, compliances and own weight of the arm.
        structure: Structure of the compliances, n parameters.
        posterior: Posterior of these n parameters.
        origin: Method, files of readings, warnings and largest load.
    """
    first = Unknowns(arm_state.vjm, (), {}, arm_state.error_terms, structure).first_columns["elastic"]
    return ArmModel(arm_state, structure, first + np.arange(structure.n_parameters), posterior, origin)


@runtime_checkable
class ModelSource(Protocol):
    """Describe an object with a method `model()` that returns an identified arm, such as `Calibration`."""

    def model(self) -> ArmModel:
        """Return the identified arm: its compliances, perhaps its geometry, and their posterior."""
