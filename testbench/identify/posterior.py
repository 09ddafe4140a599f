"""Uncertainty of everything that is linear in the unknowns: one posterior for estimates and calibrations.

The covariance (M^T M)^+ is that of weighted least squares, Eq. (14)-(15). M holds the rows of the data over
their standard deviation and, with a prior, those of the prior below them. A direction that M does not
determine has an infinite standard deviation. GCO away from the boundary of the cone has the same
distribution.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from testbench.model.load import BodyMasses, first_order_deflection, nonlinear_deflection, secant_theta
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, evaluate_chain, marker_positions, observation_matrix

# --- Uncertainty of everything that is linear in the unknowns -----------------------------------------------

UNSEEN_SHARE = 1e-8
"""Share of a functional in unobservable directions above which it is unobservable [1]: rounding is 1e-11."""
#: Distance from the optimum without a cone from which the cone counts as binding [standard deviations].
BINDING_DISTANCE = 0.1
CONFIDENCE = 0.95
COVARIANCE_RIDGE, TINY = 1e-12, 1e-100
"""Ridge added to a covariance before its root, relative to its mean diagonal, and the least ridge."""
INTERVAL_BATCH = 600  #: Deflections whose intervals are computed in one batch: limits memory.
CURVATURE_COUNT = 2.0
"""Factor of the terms that a linear model leaves out: once for the prediction, once for their effect on the
parameters. On an arm that moves by 9 to 41 mm (`arm_6r`, 18 full poses, non-linear truths of the family,
seeds 1 to 5) 95 % intervals cover 68 % without it, 97 % with it."""
PRIOR_STUDENT_DOF = 4.0
"""Degrees of freedom of the Student distribution of the prior's part in prediction errors.

Priors are wrong in more ways than a normal distribution covers; readings are not. Over fourteen kinds of true
arms (`plant.true_arms`, seeds 740001 to 740017, 8 poses, wrong priors) 90, 95 and 98 % of errors are
within 1.6, 2.0 and 2.3 standard deviations of noise plus 1.8, 2.4 and 3.2 of the prior's part; cast links
take 2.5, 3.2 and 4.0. Student's distribution with 4 degrees of freedom has 2.1, 2.8 and 3.7.
"""


@dataclass(frozen=True, repr=False)
class Intervals(Displayed):
    """Hold intervals of predictions, such as deflections [m] along each axis, (runs, m, 3)."""

    centre: Array  #: The predictions, of any shape.
    lower: Array  #: Lower ends; -inf where the readings determine nothing.
    upper: Array  #: Upper ends; inf where the readings determine nothing.
    confidence: float  #: Probability that one interval contains the truth, 0.95 by default [1].
    on_boundary: bool  #: Whether the cone holds the estimate; the intervals are then not exact.


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Displayed):
    """Hold a normal distribution of the unknowns about their estimate.

    A linear functional a has the value a @ x and the standard deviation |root a|, with root^T root = (M^T
    M)^-1 and M the whitened rows of readings and prior. The part of a learnt prior has Student's distribution
    and adds in quadrature.
    """

    x: Array  #: Estimate, the centre of the distribution, (n,).
    root: Array  #: The covariance of x is root^T root in observable directions, (r, n).
    unobservable: Array  #: Rows whose products with an observable functional are zero, (f, n).
    scale: Array  #: Scale of each unknown, to tell rounding errors from a value, (n,).
    #: Degrees of freedom of the Student distribution of the prior's part; infinite for a normal one.
    student_dof: float = math.inf
    prior_rows: int = 0  #: Number of rows of the root, the last ones, that are the prior's part.
    #: Distance between the estimate and the optimum without a cone [standard deviations].
    cone_distance: float = 0.0
    on_boundary: bool = False  #: Whether the cone holds the estimate.

    @classmethod
    def normal(cls, x: Array, root: Array) -> "Posterior":
        """Make a posterior whose unknowns are all determined.

        Args:
            x: Centre, (n,).
            root: Root of the covariance root^T root, (r, n).
        """
        return cls(x, root, np.zeros((0, len(x))), np.ones(len(x)))

    @classmethod
    def of_rows(cls, M: Array, L: Array, x: Array) -> "Posterior":
        """Make the posterior of unknowns x = L z from rows of known equations in z.

        Mathematics: `int-1`.

        Args:
            M: Rows in standard deviations, (e, n) [1].
            L: Unknowns per unit of z, (n, n).
            x: Centre, (n,).

        Returns:
            The posterior; directions that M does not observe have infinite deviation.
        """
        back, unobservable = _inverse(M)
        return cls(x, back @ L.T, unobservable @ L.T, np.linalg.norm(L, axis=1))

    def deviations(self, functionals: Array) -> Array:
        """Compute the standard deviations of linear functionals of x.

        Mathematics: `int-2`.

        Args:
            functionals: One per row, (k, n).

        Returns:
            Standard deviations, (k,); infinite for a functional that the data do not determine.

        Raises:
            BenchError: When a functional has another length or is not finite.
        """
        return self._deviations(functionals)[0]

    def _deviations(self, functionals: Array) -> tuple[Array, Array]:
        """Compute standard deviations, and the part of them that is due to the prior, (k,) each."""
        a = check_array(functionals, (None, len(self.x)), "functionals [m per unit of pi]")
        white = a @ self.root.T
        heavy = white[:, len(self.root) - self.prior_rows :]
        seen, prior = (np.sqrt(np.vecdot(part, part)) for part in (white, heavy))
        if not len(self.unobservable):
            return seen, prior
        size = np.linalg.norm(a * self.scale, axis=1)
        unobservable = np.linalg.norm(a @ self.unobservable.T, axis=1) > UNSEEN_SHARE * size
        return np.where(unobservable, np.inf, seen), prior

    def half_widths(self, functionals: Array, confidence: float = CONFIDENCE) -> Array:
        """Compute half widths of intervals of functionals: noise and prior in quadrature.

        Mathematics: `int-6`.

        Args:
            functionals: One per row, (k, n).
            confidence: Coverage of each interval by itself [1].

        Returns:
            Half width of each, (k,).

        Raises:
            BenchError: When the confidence is outside (0, 1) or a functional has another length.
        """
        check_confidence(confidence)
        whole, prior = self._deviations(functionals)
        normal, student = (
            quantile(student_dof, (1 + confidence) / 2) for student_dof in (math.inf, self.student_dof)
        )
        return np.asarray(np.hypot(normal * whole, math.sqrt(max(0, student**2 - normal**2)) * prior))

    def intervals(self, functionals: Array, confidence: float = CONFIDENCE) -> Intervals:
        """Compute intervals of functionals around the estimate.

        Args:
            functionals: One per row, (k, n).
            confidence: Coverage of each interval by itself [1].

        Returns:
            The intervals, (k,) each end.

        Raises:
            BenchError: When the confidence is outside (0, 1) or a functional has another length.
        """
        half = self.half_widths(functionals, confidence)
        centre = functionals @ self.x
        return Intervals(centre, centre - half, centre + half, confidence, self.on_boundary)

    def covariance(self, functionals: Array) -> Array:
        """Compute the covariances of groups of functionals that the data determine.

        Args:
            functionals: Groups of k functionals, (..., k, n).

        Returns:
            Covariances, (..., k, k).
        """
        white = functionals @ self.root.T
        return np.asarray(white @ white.swapaxes(-1, -2))


def intervals(vjm: Vjm, estimate: Estimate, data: Dataset, confidence: float = CONFIDENCE) -> Intervals:
    """Compute intervals of the deflections that an estimate predicts.

    The half width adds in quadrature the noise, the prior and `CURVATURE_COUNT` times the second-order
    deflection that the linear model omits, see `second_order_deflection`.

    Mathematics: `int-8`.

    Args:
        vjm: The arm's virtual joint model.
        estimate: From least squares, or with a prior; from GCO without a prior away from the cone's boundary.
        data: Gives poses, loads and markers; its readings are not used.
        confidence: Coverage of each interval by itself [1].

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
    together, ends = max(1, INTERVAL_BATCH // len(points)), []
    for first in range(0, data.runs, together):
        block = select_rows(data, np.arange(first, min(first + together, data.runs)))
        where = evaluate_chain(set_load_history(vjm, block.taken_off), block.q)
        rows = observation_matrix(where, estimate.structure, block.wrench, block.point, points)
        bounds = posterior.intervals(rows.reshape(-1, estimate.structure.n_parameters), confidence)
        centre, upper = (end.reshape(rows.shape[:3]) for end in (bounds.centre, bounds.upper))
        # Widths by noise and prior, and by terms that the linear model omits: independent, in quadrature.
        half = np.hypot(
            upper - centre, CURVATURE_COUNT * second_order_deflection(vjm, estimate.C_theta, block)
        )
        ends.append((centre, centre - half, centre + half))
    centre, lower, upper = map(np.concatenate, zip(*ends, strict=True))
    return Intervals(centre, lower, upper, confidence, posterior.on_boundary)


def second_order_deflection(vjm: Vjm, C_theta: Array, data: Dataset) -> Array:
    """Compute the second-order deflection that a linear model omits, on its own weightless arm.

    The load acts, and the targets are, where the linear deflection brings them: one step of the fixed point
    of Eq. (7). One step exists for any C_theta.

    Mathematics: `int-7`.

    Args:
        vjm: The arm's virtual joint model.
        C_theta: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        data: Gives poses, loads and markers; its readings are not used.

    Returns:
        Deflection after the step minus linear deflection in base axes, (runs, m, 3) [m].
    """
    points, where = marker_positions(vjm, data.markers), evaluate_chain(vjm, data.q)
    theta = secant_theta(where, C_theta, data.wrench, data.point)
    again = secant_theta(evaluate_chain(vjm, data.q, theta), C_theta, data.wrench, data.point)
    return nonlinear_deflection(vjm, data.q, again, points) - first_order_deflection(where, theta, points)


def posterior_of_estimate(estimate: Estimate) -> Posterior:
    """Compute the posterior of an estimate's parameters, Eq. (14)-(15); its prior counts as data.

    Mathematics: `int-1`, `int-3`, `int-5`.

    Args:
        estimate: From any method.

    Returns:
        The posterior, of a mixture where the estimate averages models.
    """
    if estimate.average is not None:
        return _averaged(estimate, estimate.average)
    regression, weighted_prior = estimate.regression, estimate.weighted_prior
    L = np.diag(sensitivity_units(regression)) if weighted_prior is None else weighted_prior.scaling.L
    blocks = [math.sqrt(t.n_equations / 3) * np.c_[t.R @ L, t.z] for t in regression.terms]
    if weighted_prior is not None:
        blocks.append(np.column_stack(prior_rows(weighted_prior.scaling, weighted_prior.uncertainty)))
    x, rows = np.r_[np.linalg.solve(L, estimate.pi), -1.0], [block[:, :-1] for block in blocks]
    back, unobservable = _inverse(np.vstack(rows))
    pull = _distance_without_cone(estimate, rows, back, [block @ x for block in blocks])
    learnt = weighted_prior is not None and weighted_prior.hyperparameter_effect is not None
    if weighted_prior is not None and learnt:
        root, heavy = _noise_and_prior_roots(rows, back, weighted_prior, L)
    else:
        root, heavy = (1.0 if weighted_prior is None else weighted_prior.misfit) * back @ L.T, 0
    if regression.pose_variation is not None:  # links vary in new poses again: additional scatter
        root = np.vstack([regression.pose_variation, root])
    return Posterior(
        x=estimate.pi,
        root=root,
        unobservable=unobservable @ L.T,
        scale=np.linalg.norm(L, axis=1),
        student_dof=PRIOR_STUDENT_DOF if learnt else math.inf,
        prior_rows=heavy,
        cone_distance=pull,
        on_boundary=estimate.conservative and pull > BINDING_DISTANCE,
    )


def _inverse(M: Array) -> tuple[Array, Array]:
    """Compute a root of (M^T M)^+, (r, n), and the directions that rows M do not observe, (n - r, n)."""
    _, s, Vt = np.linalg.svd(np.linalg.qr(M, mode="r"))
    r = int((s > RANK_TOLERANCE * s[0]).sum()) if s[0] > 0 else 0
    return Vt[:r] / s[:r, None], Vt[r:]


def conditional_covariance(K: Array, variables: Ids, given: Ids) -> Array:
    """Compute the covariance of some variables, given others: K_oo - K_ok K_kk^-1 K_ko.

    Args:
        K: Covariance of all variables, (n, n).
        variables: Places of the variables, (o,).
        given: Places of those that are known exactly, (k,).

    Returns:
        Conditional covariance, (o, o).
    """
    C, X = K[np.ix_(given, given)], K[np.ix_(variables, given)]
    ridge = (COVARIANCE_RIDGE * np.trace(C) / len(C) + TINY) * np.eye(len(C))
    return np.asarray(K[np.ix_(variables, variables)] - X @ np.linalg.solve(C + ridge, X.T))


def _averaged(estimate: Estimate, average: ModelAverage) -> Posterior:
    """Mix the posteriors of averaged models by probability, each widened by its distance from the mean."""
    if average.under_each_prior:
        parts = [(p, posterior_of_estimate(model)) for p, model in average.under_each_prior]
    elif average.with_joint_couplings is not None:
        p = average.joint_couplings_weight
        tied = _embed(
            posterior_of_estimate(average.with_joint_couplings),
            average.with_joint_couplings.structure,
            estimate.structure,
        )
        others = [] if p == 1 else [((1 - p) * q, posterior) for q, posterior in _uncoupled_parts(average)]
        parts = [(p, tied), *others]
    else:
        parts = _uncoupled_parts(average)
    alone = parts[0][1]
    if len(parts) == 1 and np.array_equal(alone.x, estimate.pi):
        return alone
    return _mixture(estimate.pi, parts)


def _uncoupled_parts(average: ModelAverage) -> list[tuple[float, Posterior]]:
    """Select the models with uncoupled joints, and their relative probabilities."""
    p, q = average.joint_laws_probability, average.joints_only_probability
    lawful = [] if average.with_joint_laws is None else [(p, posterior_of_estimate(average.with_joint_laws))]
    if p == 1:
        return lawful
    parts = [*lawful, ((1 - p) * (1 - q), posterior_of_estimate(average.links_and_joints))]
    if average.joints_only is not None:
        alone = _embed(
            posterior_of_estimate(average.joints_only),
            average.joints_only.structure,
            average.links_and_joints.structure,
        )
        parts.append(((1 - p) * q, alone))
    return parts


def _embed(posterior: Posterior, structure: Structure, widest: Structure) -> Posterior:
    """Embed a posterior in the unknowns of a wider structure; all others are zero."""
    x, root, unobservable, scale = (
        embed_parameters(numbers, structure, widest)
        for numbers in (posterior.x, posterior.root, posterior.unobservable, posterior.scale)
    )
    return replace(posterior, x=x, root=root, unobservable=unobservable, scale=scale)


def _mixture(pi: Array, parts: Sequence[tuple[float, Posterior]]) -> Posterior:
    """Mix posteriors by probability about a common mean; some lack the last unknowns, sizes of joint laws."""
    noise, heavy = [], []
    for p, posterior in parts:
        rows, first = np.zeros((len(posterior.root) + 1, len(pi))), len(posterior.root) - posterior.prior_rows
        rows[:-1, : len(posterior.x)], rows[-1] = posterior.root, pi
        rows[-1, : len(posterior.x)] -= posterior.x
        noise.append(math.sqrt(p) * rows[:first])
        heavy.append(math.sqrt(p) * rows[first:])
    widest = max((member for _, member in parts), key=lambda member: len(member.x))
    root, prior = (np.linalg.qr(np.vstack(rows), mode="r") for rows in (noise, heavy))
    return replace(widest, x=pi, root=np.vstack([root, prior]), prior_rows=len(prior))


def _noise_and_prior_roots(
    rows: list[Array], back: Array, weighted_prior: WeightedPrior, L: Array
) -> tuple[Array, int]:
    """Compute the root of the covariance: the part of noise, and rows of the part of the prior's error.

    With M the rows A of the readings above those B of the prior, the covariance is (M^T M)^-1 (A^T A + B^T B)
    (M^T M)^-1: the effect of noise on the estimate, and that of an error of the prior. Learnt sizes of these
    errors are uncertain: by the law of total variance their mean squares count, rows of B times
    `size_uncertainty`. The changes of the estimate with the sizes are further rows.
    """
    assert weighted_prior.hyperparameter_effect is not None
    assert weighted_prior.size_uncertainty is not None
    *readings, prior = (
        row @ back.T for row in [*rows[:-1], weighted_prior.size_uncertainty[:, None] * rows[-1]]
    )
    noise = np.linalg.qr(np.vstack(readings), mode="r") @ back
    open_ = np.linalg.qr(prior, mode="r") @ back
    root = np.vstack(
        [
            weighted_prior.misfit * noise @ L.T,
            weighted_prior.misfit * open_ @ L.T,
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


def quantile(student_dof: float, p: float) -> float:
    """Compute a quantile of Student's distribution, or of the normal one.

    Args:
        student_dof: Degrees of freedom; infinite for the normal distribution.
        p: Probability, in (0, 1) [1].

    Returns:
        The quantile in standard deviations of the normal limit [1].
    """
    if math.isinf(student_dof):
        return NormalDist().inv_cdf(p)
    if student_dof == 4:  # as `PRIOR_STUDENT_DOF`: a closed form (Shaw 2006), and scipy takes long to import
        root = 2 * math.sqrt(p * (1 - p))
        return math.copysign(2 * math.sqrt(math.cos(math.acos(root) / 3) / root - 1), p - 0.5)
    from scipy.special import stdtrit

    return float(stdtrit(student_dof, p))


def check_confidence(confidence: float) -> None:
    """Check that a confidence [1] is between 0 and 1.

    Raises:
        BenchError: If it is not.
    """
    if not 0 < confidence < 1:
        raise BenchError(f"confidence: expected a number between 0 and 1, got {confidence}")


# --- An identified arm: its state, the uncertainty of that, and its origin ----------------------------------


@dataclass(frozen=True)
class ModelOrigin:
    """Hold the origin of a model: method, files of readings, warnings and largest load."""

    method: str  #: Method that found it.
    #: SHA-256 of every file of readings, by its name.
    file_hashes: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()  #: Warnings about the model, as sentences.
    largest_force: float | None = None  #: Largest force in the readings [N]; None if unknown.
    #: Largest moment about the tool's origin in the readings [N m]; None if unknown.
    largest_moment: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class ArmModel:
    """Hold an identified arm: from deflections compliances only, from absolute readings geometry too."""

    state: ArmState  #: theta = theta_0 + C_theta u + Phi(q) n, own weight included.
    structure: Structure  #: Structure of the uncertain compliances.
    columns: Ids  #: Columns of `unknowns` that are uncertain, (c,).
    posterior: Posterior  #: Posterior of these unknowns.
    origin: ModelOrigin  #: Method, files of readings, warnings and largest load.
    #: Noise of absolute readings about the model; None where geometry and joint errors were not identified.
    noise: Noise | None = None

    def __repr__(self) -> str:
        return (
            f"ArmModel(arm={self.arm.name}, method={self.origin.method}, structure={self.structure.name}, "
            f"unknowns={len(self.columns)}, absolute={self.absolute})"
        )

    @property
    def vjm(self) -> Vjm:
        """Return the virtual joint model of the nominal arm."""
        return self.state.vjm

    @property
    def arm(self) -> Arm:
        """Return the arm's description, as its folder has it."""
        return self.vjm.arm

    @property
    def absolute(self) -> bool:
        """Tell whether geometry and joint errors were identified too."""
        return self.noise is not None

    @property
    def scatter(self) -> float:
        """Return the standard deviation of positions that the calibrated model leaves unexplained [m]."""
        return 0.0 if self.noise is None else self.noise.position_model_error * float(self.noise.factor[0])

    @property
    def unknowns(self) -> Unknowns:
        """Return which column each unknown of an arm model has: geometry, joint errors, then compliances."""
        return Unknowns(self.vjm, (), {}, self.state.error_terms, self.structure)


def model_of_estimate(vjm: Vjm, estimate: Estimate, weights: BodyMasses) -> ArmModel:
    """Convert an estimate of the compliances of a nominal arm to a model.

    Args:
        vjm: The arm.
        estimate: An estimate, from any estimator.
        weights: Weights of the links, such as `read_body_masses`.
    """
    state = elastic_state(vjm_for_structure(vjm, estimate.structure), estimate.C_theta, weights)
    return model_of_compliances(
        state, estimate.structure, posterior_of_estimate(estimate), ModelOrigin(estimate.method)
    )


def elastic_state(vjm: Vjm, C_theta: Array, weights: BodyMasses) -> ArmState:
    """Make the state of a nominal arm with given compliances.

    Args:
        vjm: The arm's virtual joint model.
        C_theta: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        weights: Weights of the links.
    """
    return replace(nominal_state(vjm, weights, np.zeros(vjm.arm.n_joints)), C_theta=C_theta)


def model_of_compliances(
    state: ArmState, structure: Structure, posterior: Posterior, origin: ModelOrigin
) -> ArmModel:
    """Make an arm model whose only uncertain unknowns are compliances.

    Args:
        state: The arm's state.
        structure: The compliances, n of them.
        posterior: Their posterior.
        origin: Origin of the model.
    """
    first = Unknowns(state.vjm, (), {}, state.error_terms, structure).first_columns["elastic"]
    return ArmModel(state, structure, first + np.arange(structure.n_parameters), posterior, origin)


@runtime_checkable
class ModelSource(Protocol):
    """Describe objects with a method `model()` that returns an identified arm, such as a `Calibration`."""

    def model(self) -> ArmModel:
        """Return the identified arm."""
