"""Empirical Bayes: the readings determine the sizes of unknowns and the noise of a linear model.

Some of the c unknowns have a prior N(m(h), d(h)^2), with one deviation d for all unknowns of a group. The
others are free, or determined by equations that count as exact. With y_k = A_k x + noise of deviation s_k(h)
for each kind k of equations, the hyperparameters h, all logarithms, maximise the evidence (MacKay 1992):

    -log p(y, h) = sum_k (|y_k - A_k x|^2 / s_k^2 + 2 n_k log s_k) / 2
                   + sum_i ((x_i - m_i)^2 / d_i^2 + log d_i^2) / 2 + log det P / 2 - log p(h)

with the most probable unknowns x and their precision P = sum_k A_k^T A_k / s_k^2 + diag(d^-2). Only the Gram
matrices of the equations are needed.

`learn_prior` applies this to a hierarchical prior of the compliances. In units of the prior a block is
x_k = s_k (e_k + d xi): it has a scale s_k, and entries that scatter about their expectation e_k. The relative
deviation d is u for the entries of a straight beam, and c for couplings that no straight beam has; in the
block of a whole link it is multiplied by w. The scales of links, and those of joints, have a Student
distribution about a common factor of their kind: most are similar, a few differ much. The hyperparameters
h = (log s, factors, log w, log u, log c, log kappa), with kappa the factor of the noise, maximise the
evidence. So if the CAD model of the joints, or of one link, is wrong by a factor of ten, the readings correct
it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from testbench.errors import Array, BenchError, Ids
from testbench.identify.prior import (
    LearntScale,
    PriorScaling,
    PriorUncertainty,
    WeightedPrior,
    prior_rows,
    rescale_to_data,
    rows_in_prior_units,
)
from testbench.identify.regression import Regression
from testbench.model.laws import law_kinds, law_size_prior

# --- Empirical Bayes for a linear model ---------------------------------------------------------------------

MIN_EVIDENCE_GAIN_OF_STEP = 1e-4
"""Gain of log evidence below which a Newton step is the last one: the next step would gain its square [1]."""
MAX_NEWTON_STEPS, MAX_HALVINGS = 100, 30  #: Most Newton steps, and most times that one is halved.
STUDENT_SCALE, STUDENT_DOF = 0.4, 4.0
"""Scale and degrees of freedom of the Student distribution of log scales: most are similar, a few differ."""
MIN_CURVATURE, MAX_STEP_LENGTH = 1e-3, 2.0
"""Least second derivative of the log evidence that a Newton step uses, and its longest component [1]."""


@dataclass(frozen=True)
class Hyperprior:
    """Hold prior densities of k linear functions of the m hyperparameters h: z = R h - offset."""

    coefficients: Array  #: Coefficients R of the linear functions, (k, m).
    offset: Array  #: Value of R h at z = 0, (k,).
    #: Function of z, (k,), to -log p(z) of every z and its first and second derivatives, (k,) each.
    neg_log_density: Callable[[Array], tuple[Array, Array, Array]]


def normal_neg_log_density(z: Array) -> tuple[Array, Array, Array]:
    """Compute -log of the standard normal density without its constant, and its derivatives.

    Args:
        z: Arguments, (k,) [1].

    Returns:
        z^2 / 2, and its first and second derivatives with respect to z, (k,) each.
    """
    return z**2 / 2, z, np.ones_like(z)


def student_neg_log_density(z: Array) -> tuple[Array, Array, Array]:
    """Compute -log of Student's density with `STUDENT_DOF` degrees of freedom, without its constant.

    Args:
        z: Arguments, (k,) [1].

    Returns:
        -log p(z), and its first and second derivatives with respect to z, (k,) each.
    """
    over = STUDENT_DOF + z**2
    return (
        (STUDENT_DOF + 1) / 2 * np.log(over / STUDENT_DOF),
        (STUDENT_DOF + 1) * z / over,
        (STUDENT_DOF + 1) * (STUDENT_DOF - z**2) / over**2,
    )


@dataclass(frozen=True, eq=False)
class EvidenceModel:
    """Hold a linear model A x = y of c unknowns x, with a prior that depends on m hyperparameters h.

    The last hyperparameters are log s_k, with s_k the noise of each kind k of equations.
    """

    gram_matrices: Array  #: Gram matrix [A | y]^T [A | y] of every kind of equations, (kinds, c + 1, c + 1).
    equation_counts: Array  #: Number of equations of every kind, (kinds,).
    #: Gram matrix of equations in which the noise is known to be 1, (c + 1, c + 1).
    gram_matrix_of_known_noise: Array
    #: Matrix D of the prior deviations, log d = D h; zero rows for unknowns without a prior, (c, m).
    log_deviation_rows: Array
    expected_over_scale: Array  #: Prior means m_i of the unknowns over their scales exp(S h), (c,).
    log_scale_rows: Array  #: Matrix S of the scales of the prior means, (c, m).
    hyperpriors: tuple[Hyperprior, ...]  #: Priors of the hyperparameters.
    bounds: Array  #: Least and largest value of every hyperparameter, (2, m).


@dataclass(frozen=True)
class NormalEquationsSolution:
    """Hold the solution x of normal equations P x = A^T y, and a factor of the precision P."""

    x: Array  #: Most probable unknowns, (c,).
    #: Cholesky factor of P scaled to unit diagonal, (c, c), and whether it is lower.
    precision_root: tuple[Array, bool]
    precision_scale: Array  #: Square roots of the diagonal of P, (c,).

    @property
    def log_determinant(self) -> float:
        """Compute the logarithm of the determinant of the precision P."""
        return 2 * float(np.log(np.diag(self.precision_root[0]) * self.precision_scale).sum())

    @property
    def covariance(self) -> Array:
        """Compute the covariance P^-1 of all unknowns, (c, c)."""
        half = dpotri(self.precision_root[0], lower=0)[0]
        inverse = np.where(np.tri(len(half), dtype=bool), half.T, half)
        return np.asarray(inverse / self.precision_scale / self.precision_scale[:, None])

    def variances(self, indices: Ids) -> Array:
        """Compute the variances of some unknowns: diagonal entries of P^-1.

        Args:
            indices: Indices of the unknowns, (k,).

        Returns:
            Variances, (k,), in the squared units of the unknowns.
        """
        unit = np.eye(len(self.precision_scale))[:, indices]
        return np.asarray(
            (unit * cho_solve(self.precision_root, unit)).sum(axis=0) / self.precision_scale[indices] ** 2
        )


def solve_normal_equations(gram: Array) -> NormalEquationsSolution:
    """Solve the normal equations A^T A x = A^T y of whitened equations for the most probable unknowns.

    Args:
        gram: Gram matrix [A | y]^T [A | y] of readings and prior, (c + 1, c + 1).

    Raises:
        BenchError: If an unknown is undetermined; it is a frame or target, as all others have a prior.
    """
    size = np.sqrt(np.diag(gram)[:-1])
    try:
        root = cho_factor(gram[:-1, :-1] / np.where(size > 0, size, np.nan) / size[:, None])
    except (np.linalg.LinAlgError, ValueError):  # not positive definite, or not finite
        raise BenchError(
            "calibration: the readings do not determine a frame or target; expected more poses"
        ) from None
    return NormalEquationsSolution(cho_solve(root, gram[:-1, -1] / size) / size, root, size)


@dataclass(frozen=True)
class EvidencePosterior:
    """Hold the posterior of unknowns x at hyperparameters h, and the negative log evidence -log p(y, h)."""

    h: Array  #: Hyperparameters, (m,) [1].
    solution: NormalEquationsSolution  #: Most probable unknowns x.
    covariance: Array  #: Posterior covariance V = P^-1 of the unknowns, (c, c).
    prior_deviation: Array  #: Prior deviations d of the unknowns, infinite for those without a prior, (c,).
    prior_mean: Array  #: Prior means m of the unknowns, (c,).
    residual_squares: Array  #: |y_k - A_k x|^2 / s_k^2 of every kind k of equations, (kinds,) [1].
    #: Effective number of unknowns that each kind of equations determines, tr(V A_k^T A_k) / s_k^2, (kinds,).
    effective_parameters: Array
    neg_log_evidence: float  #: -log p(y, h) [1].
    gradient: Array  #: Gradient of -log p(y, h) with respect to h, (m,) [1].


def evidence_posterior(model: EvidenceModel, h: Array) -> EvidencePosterior:
    """Compute the posterior of the unknowns, and -log p(y, h), at given hyperparameters.

    Mathematics: `prior-8`.

    Args:
        model: The linear model, c unknowns and m hyperparameters.
        h: Hyperparameters, logarithms, (m,) [1].

    Raises:
        BenchError: When the equations leave an unknown undetermined, or rounding makes the precision P
            indefinite.
    """
    kinds, D = len(model.equation_counts), model.log_deviation_rows
    d, s2 = np.where(D.any(axis=1), np.exp(D @ h), np.inf), np.exp(2 * h[-kinds:])
    mean = np.exp(model.log_scale_rows @ h) * model.expected_over_scale
    # Gram matrix of readings and prior, and the most probable unknowns.
    H = model.gram_matrix_of_known_noise + sum(
        gram / variance for gram, variance in zip(model.gram_matrices, s2, strict=True)
    )
    H[:-1, -1] += mean / d**2
    H.flat[: -1 : len(H) + 1] += d**-2
    solved = solve_normal_equations(H)
    V = solved.covariance
    v = np.r_[solved.x, -1.0]
    off = (solved.x - mean) / d
    left = model.gram_matrices @ v @ v / s2
    spent = np.array([np.vdot(gram[:-1, :-1], V) for gram in model.gram_matrices]) / s2
    # -log p, its derivative, and the hyperpriors.
    value = (left.sum() + off @ off + v @ model.gram_matrix_of_known_noise @ v + solved.log_determinant) / 2
    value += model.equation_counts @ h[-kinds:] + (D @ h).sum()
    g = D.T @ (D.any(axis=1) - off**2 - np.diag(V) / d**2) - model.log_scale_rows.T @ (mean * off / d)
    g[-kinds:] += model.equation_counts - left - spent
    for prior in model.hyperpriors:
        of, slope, _ = prior.neg_log_density(prior.coefficients @ h - prior.offset)
        value, g = value + of.sum(), g + prior.coefficients.T @ slope
    return EvidencePosterior(h, solved, V, d, mean, left, spent, float(value), g)


def evidence_hessian(model: EvidenceModel, posterior: EvidencePosterior) -> tuple[Array, Array]:
    """Compute the Hessian of the negative log evidence -log p(y, h) with respect to the hyperparameters h.

    The most probable unknowns x depend on h, so the differentiation is implicit.

    Let U = -d^2 (-log p) / dx dh, so that dx/dh = V U with the covariance V = P^-1. At the most probable x
    the Hessian is smaller by U^T V U than at a fixed x. The second derivative of log det P is
    tr(V P'') - tr(V P' V P').

    Mathematics: `prior-9`.

    Args:
        model: The linear model.
        posterior: Posterior of the unknowns at h.

    Returns:
        Hessian, (m, m) [1], and dx/dh, (c, m).
    """
    h = posterior.h
    D = model.log_deviation_rows
    S = model.log_scale_rows
    V = posterior.covariance
    kinds = len(posterior.residual_squares)
    w, off = (
        posterior.prior_deviation**-2,
        (posterior.solution.x - posterior.prior_mean) / posterior.prior_deviation,
    )
    a = off / posterior.prior_deviation
    K = np.eye(len(h))[-kinds:]
    s2 = np.exp(2 * h[-kinds:])
    # U: derivative of the gradient in x by h; J = V U is how x moves.
    pulls = (model.gram_matrices @ np.r_[posterior.solution.x, -1.0])[:, :-1] / s2[:, None]
    U = 2 * a[:, None] * D + (w * posterior.prior_mean)[:, None] * S + 2 * pulls.T @ K
    J = V @ U
    shares = _shares(model, V, w, s2)
    N = w[:, None] * (np.array([(M * V).sum(axis=1) for M in shares]).T @ K)
    wD = w[:, None] * D
    # Second derivatives of the quadratic form and of log det P.
    traces = np.array([[np.vdot(M, other.T) for other in shares] for M in shares])
    mixed = D.T @ ((posterior.prior_mean * a)[:, None] * S) - D.T @ N
    H = 2 * D.T @ ((off**2 + np.diag(V) * w)[:, None] * D) + 2 * (mixed + mixed.T) - U.T @ J
    H += S.T @ ((posterior.prior_mean**2 * w - posterior.prior_mean * a)[:, None] * S) - 2 * wD.T @ V**2 @ wD
    H += 2 * K.T @ (np.diag(posterior.residual_squares + posterior.effective_parameters) - traces) @ K
    for prior in model.hyperpriors:
        bend = prior.neg_log_density(prior.coefficients @ h - prior.offset)[2]
        H += prior.coefficients.T @ (bend[:, None] * prior.coefficients)
    return H, J


def _shares(model: EvidenceModel, V: Array, w: Array, s2: Array) -> list[Array]:
    """V A_k^T A_k / s_k^2 of every kind, (c, c); with V times all else in P they are one."""
    shares = [
        V @ (gram[:-1, :-1] / variance) for gram, variance in zip(model.gram_matrices[:-1], s2, strict=False)
    ]
    last = np.eye(len(V)) - V * w - sum(shares)
    on = np.flatnonzero(model.gram_matrix_of_known_noise[:-1].any(axis=1))
    last[:, on] -= V[:, on] @ model.gram_matrix_of_known_noise[np.ix_(on, on)]
    return [*shares, last]


def maximise_evidence(
    model: EvidenceModel, start: Array, fixed_index: int | None = None
) -> EvidencePosterior:
    """Maximise the evidence over the hyperparameters by Newton's method with step halving.

    Mathematics: `prior-9`.

    Args:
        model: The linear model.
        start: Hyperparameters to start from, (m,) [1].
        fixed_index: Index of a hyperparameter that keeps its value; None for none.

    Returns:
        The posterior at the hyperparameters of greatest evidence within the bounds.
    """
    posterior = evidence_posterior(model, start)
    low, high = model.bounds
    for _ in range(MAX_NEWTON_STEPS):
        h = posterior.h
        g = posterior.gradient
        # A hyperparameter at its bound is free only if the loss falls inwards.
        free = ~((h <= low) & (g > 0) | (h >= high) & (g < 0))
        if fixed_index is not None:
            free[fixed_index] = False
        values, Q = np.linalg.eigh(evidence_hessian(model, posterior)[0][np.ix_(free, free)])
        # Newton's step with |eigenvalues|: it descends even where the loss is not convex.
        step = np.zeros_like(h)
        step[free] = -Q @ (Q.T @ g[free] / np.maximum(np.abs(values), MIN_CURVATURE))
        before, posterior = posterior.neg_log_evidence, _halved_step(model, posterior, step)
        if before - posterior.neg_log_evidence < MIN_EVIDENCE_GAIN_OF_STEP:
            break
    return posterior


def _halved_step(model: EvidenceModel, posterior: EvidencePosterior, step: Array) -> EvidencePosterior:
    """Find the point where a step, or a part of it, increases the evidence; the start if none does."""
    step = step * min(1.0, MAX_STEP_LENGTH / np.abs(step).max(initial=MAX_STEP_LENGTH))
    for _ in range(MAX_HALVINGS):
        there = np.clip(posterior.h + step, *model.bounds)
        try:
            trial = evidence_posterior(model, there)
        except BenchError:
            trial = posterior
        if trial.neg_log_evidence < posterior.neg_log_evidence:
            return trial
        step = step / 2
    return posterior


# --- A hierarchical prior: its scales and uncertainties are learnt from the readings before it is used ------

JOINT_TO_LINK_SCALE_DEVIATION = 1.5
"""Standard deviation of the logarithm of the joints' common scale over that of the links [1]."""
ENTRY_UNCERTAINTY_PRIOR = 0.5, 0.4
"""Median of the relative deviation u of entries, and standard deviation of its logarithm [1]."""
LINK_COUPLING_UNCERTAINTY_PRIOR = 0.15, 0.7
"""Median of the relative deviation c of couplings, and standard deviation of its logarithm [1]."""
JOINTS_ONLY_DEVIATION = math.hypot(STUDENT_SCALE, ENTRY_UNCERTAINTY_PRIOR[0])
"""Standard deviation of a joint's log compliance about a common scale where links are rigid [1]: that of its
scale and that of its entry together."""
JOINTS_ONLY_FIT_DEVIATION = 3.0
"""Relative prior deviation with which joint compliances are fitted where links are rigid [1]: readings that
determine the joints should not be pulled to a wrong CAD model. With JOINTS_ONLY_DEVIATION 15 % of the arms
whose links are 100 times stiffer than the CAD model's err more than 5 % more than by least squares, with this
5 % do (`kr500_l480`, seeds 1 to 40, 11 poses)."""
LOG_MISFIT_DEVIATION = 0.7
"""Standard deviation of log kappa above zero [1]; kappa is the noise of the readings over the stated one."""
LINK_UNCERTAINTY_DEVIATION = 0.5
"""Standard deviation of log w, with w the factor on the deviations of a whole link [1]. With it errors of
arms with coupled links fall by 2 % in the median and by 20 % in the best twentieth, and coverage in the worst
tenth of arms of all kinds rises by 1 to 3 points; 0.8 loses more than 5 % on a quarter of undisturbed arms
(`kr500_l480`, seeds 1 to 40, 11 poses)."""
JOINT_COUPLING_UNCERTAINTY_PRIOR = 0.2, 0.7
"""Median of the couplings of joints over the geometric mean of both compliances, and standard deviation of
its logarithm [1]. Only the model with coupled joints has them; its weight is its evidence
(`identify.average`)."""
COMMON_JOINT_SCALE_NAME = "joints"
"""Name of the common scale of all joints, as opposed to the links."""
MAX_LOG_SCALE, MAX_LOG_MISFIT = 6.0, 30.0
"""Largest log scale, a factor of 400, and largest log kappa, since misfits have no bound [1]."""
MAX_HYPERPARAMETER_DEVIATION = 1.5
"""Largest standard deviation of a hyperparameter in intervals [1]: beyond it the model is not linear."""
LawSizePriors = tuple[tuple[float, float], ...]
"""Median of the sizes of every kind of joint law, and standard deviation of their logarithm [1]."""
MAX_SIGNAL_TO_NOISE = 1e6
"""Readings over their noise beyond which rounding of their squares hides the noise [1]."""


@dataclass(frozen=True)
class LearntPriorModel:
    """Hold the evidence of the readings as a function of the hyperparameters h of a hierarchical prior.

    The hyperparameters h are logarithms, in this order: K scales s of links, joints and joint laws; a common
    factor of every kind of scale; W factors w on the uncertainty of whole links; the relative size t of joint
    couplings, if there are any; the relative uncertainties u of the entries and c of couplings in links; and
    the ratio kappa of the noise of the readings to the stated noise.
    """

    scaling: PriorScaling  #: Units of the prior, at the common scale that fits the data.
    evidence: EvidenceModel  #: Evidence of the readings.
    scale_exponents: Array  #: Exponent of every scale in the prior size of every entry of x, (n, K).
    #: Kind of every scale, numbered without gaps: links, then joints, then each kind of joint law, (K,).
    scale_kinds: Ids
    link_scale_indices: Ids  #: Indices of the scales of whole links, (W,).
    has_joint_couplings: bool  #: Whether joints are coupled, by compliances of relative size t.
    hyperparameter_medians: Array  #: Prior medians of all hyperparameters, (m,) [1].

    @property
    def n_scales(self) -> int:
        """Return the number K of scales of links, joints and joint laws."""
        return len(self.scale_kinds)

    def entry_scales(self, h: Array) -> Array:
        """Compute the prior scale of every entry of x from the hyperparameters.

        Args:
            h: Hyperparameters, (m,) [1]; the first K are the logarithms of the scales s.

        Returns:
            Scale of every entry, (n,) [1].
        """
        return np.asarray(np.exp(self.scale_exponents @ h[: self.n_scales]))


def prior_evidence_model(
    regression: Regression, scaling: PriorScaling, *, shared_link_uncertainty: bool = False
) -> LearntPriorModel:
    """Build the evidence of a dataset as a function of the hyperparameters of a hierarchical prior.

    Mathematics: `prior-7`.

    Args:
        regression: The reduced dataset.
        scaling: Prior of the dataset's structure, as units pi = L x.
        shared_link_uncertainty: Whether w is 1 for all links. Otherwise each link has its own w, and one link
            may absorb an error in few readings.

    Raises:
        BenchError: If the data require a common scale of the prior that is not above 0, or no load deflects
            the arm of the prior.
    """
    scaling = rescale_to_data(scaling, regression)
    gram = gram_matrix(regression, scaling)
    size = math.sqrt(gram.diagonal()[:-1].max())
    if size == 0:
        raise BenchError(f"prior {scaling.prior_name}: expected runs whose loads deflect the model, got none")
    # Indices in h: K scales, factors of the kinds, log w, log t, log u, log c, log kappa.
    shares, kinds, _ = scaling.scale_exponents
    kind, tied = np.unique(kinds, return_inverse=True)[1], bool(scaling.is_joint_coupling.any())
    K, whole = len(kind), np.flatnonzero((np.array(scaling.block_orders) == 6) & (scaling.block_kinds == 0))
    first = K + kind.max() + 1
    last = first + len(whole)
    m = last + tied + 3
    # Which of them scale each entry of x, and which set its relative deviation.
    of_kind = np.where(scaling.is_joint_coupling, last, np.where(scaling.is_link_coupling, m - 2, m - 3))
    start = np.zeros(m)
    scale = np.zeros((len(shares), m))
    drawn = np.eye(m)[of_kind]
    scale[:, :K], drawn[:, first:last] = shares, shares[:, whole]
    # Start at their medians, within bounds.
    start[last : last + tied] = math.log(JOINT_COUPLING_UNCERTAINTY_PRIOR[0])
    start[-3:] = (
        math.log(ENTRY_UNCERTAINTY_PRIOR[0]),
        math.log(LINK_COUPLING_UNCERTAINTY_PRIOR[0]),
        max(0.0, math.log(size / MAX_SIGNAL_TO_NOISE)),
    )
    bounds = np.array([-MAX_LOG_SCALE, MAX_LOG_SCALE])[:, None] * np.ones(m)
    bounds[:, first:last] *= not shared_link_uncertainty
    bounds[:, -1] = start[-1], MAX_LOG_MISFIT
    problem = EvidenceModel(
        gram_matrices=gram[None],
        equation_counts=np.array([regression.n_equations]),
        gram_matrix_of_known_noise=np.zeros_like(gram),
        log_deviation_rows=scale + drawn,
        expected_over_scale=scaling.expected_x,
        log_scale_rows=scale,
        hyperpriors=_priors(kind, m, tied, _law_sizes(scaling)),
        bounds=bounds,
    )
    return LearntPriorModel(scaling, problem, shares, kind, whole, tied, start)


def _priors(kind: Ids, m: int, tied: bool, laws: LawSizePriors) -> tuple[Hyperprior, ...]:
    """Make the prior densities of the hyperparameters."""
    K, unit = len(kind), np.eye(m)
    # Index, median and width of every hyperparameter that is log-normal by itself.
    log_normal = [
        (m - 3, *ENTRY_UNCERTAINTY_PRIOR),
        (m - 2, *LINK_COUPLING_UNCERTAINTY_PRIOR),
        (m - 1, 1.0, LOG_MISFIT_DEVIATION),
        *((K + k, *law) for k, law in enumerate(laws, start=2)),
        *((k, 1.0, LINK_UNCERTAINTY_DEVIATION) for k in range(K + kind.max() + 1, m - 3 - tied)),
        *[(m - 4, *JOINT_COUPLING_UNCERTAINTY_PRIOR)] * tied,
    ]
    at, median, width = zip(*log_normal, strict=True)
    rows, offset = unit[list(at)] / np.array(width)[:, None], np.log(median) / width
    if kind.any():
        of_joints = (unit[K + 1] - unit[K]) / JOINT_TO_LINK_SCALE_DEVIATION
        rows, offset = np.vstack([rows, of_joints]), np.r_[offset, 0]
    scales = (unit[:K] - unit[K + kind]) / STUDENT_SCALE
    return Hyperprior(rows, offset, normal_neg_log_density), Hyperprior(
        scales, np.zeros(K), student_neg_log_density
    )


def _law_sizes(scaling: PriorScaling) -> LawSizePriors:
    """Return the priors of the sizes of every kind of joint law, the kinds of `scaling.kinds` from 2 on."""
    return tuple(law_size_prior(kind) for kind in law_kinds(scaling.structure))


def gram_matrix(regression: Regression, scaling: PriorScaling) -> Array:
    """Compute the Gram matrix [A L | y]^T [A L | y] of whitened equations A pi = y in units pi = L x.

    Args:
        regression: The reduced dataset.
        scaling: Prior of the dataset's structure, as units pi = L x.

    Returns:
        Gram matrix, (n + 1, n + 1) [1].
    """
    rows = np.column_stack(rows_in_prior_units(regression, scaling))
    gram = rows.T @ rows
    gram[-1, -1] += math.fsum(term.n_equations / 3 * term.unexplained for term in regression.terms)
    return np.asarray(gram)


def learn_prior(
    regression: Regression, scaling: PriorScaling, *, for_intervals: bool = True
) -> WeightedPrior:
    """Learn the scales and uncertainties of a prior from a dataset by empirical Bayes.

    Mathematics: `int-4`, `prior-10`.

    Args:
        regression: The reduced dataset.
        scaling: Prior of the dataset's structure, as units pi = L x.
        for_intervals: Whether to compute how uncertain the hyperparameters are, which intervals need.

    Returns:
        The prior with the learnt scale of every block and the learnt uncertainty of its entries; for
        intervals also the change of the parameters with the hyperparameters.

    Raises:
        BenchError: If the data require a common scale of the prior that is not above 0.
    """
    model = prior_evidence_model(regression, scaling)
    posterior = maximise_evidence(model.evidence, model.hyperparameter_medians)
    h = posterior.h
    u, c, kappa = np.exp(h[-3:])
    first = model.n_scales + model.scale_kinds.max() + 1  # log w is behind the scales and their factors
    shares = np.ones(len(scaling.block_orders))
    shares[model.link_scale_indices] = np.exp(h[first : first + len(model.link_scale_indices)])
    tie = float(np.exp(h[-4]) / kappa) if model.has_joint_couplings else None
    weighted_prior = WeightedPrior(
        scaling=replace(model.scaling, L=model.scaling.L * model.entry_scales(h)),
        uncertainty=PriorUncertainty(float(u / kappa), 0.0, float(c / kappa), tuple(shares.tolist()), tie),
        noise_factor=float(kappa),
    )
    has_both_kinds = 0 < (scaling.block_kinds == 1).sum() < len(scaling.block_kinds)
    if not (has_both_kinds or for_intervals):
        return weighted_prior
    H, J = evidence_hessian(model.evidence, posterior)
    m = len(h) - 1  # kappa stays at its optimum
    values, Q = np.linalg.eigh(H[:m, :m])
    values = np.maximum(
        values, MAX_HYPERPARAMETER_DEVIATION**-2
    )  # where the evidence is flat it is not linear
    if has_both_kinds:
        weighted_prior = replace(
            weighted_prior, log_evidence=_log_evidence(model, posterior.neg_log_evidence, values)
        )
    if not for_intervals:
        return weighted_prior
    root = Q / np.sqrt(values)
    moves = (model.scaling.L @ J[:, :m] @ root).T
    # of a size d whose logarithm is normal of variance v the mean of d^2 is exp(2 v) times its median
    unsure = np.exp(((model.evidence.log_deviation_rows[:, :m] @ root) ** 2).sum(axis=1))
    return replace(
        weighted_prior,
        hyperparameter_effect=moves,
        uncertainty_factors=unsure,
        learnt_scales=_scales(model, h, root @ root.T),
    )


def _log_evidence(model: LearntPriorModel, loss: float, values: Array) -> float:
    """Compute Laplace's approximation of the log-evidence of links and joints."""
    prior = model.n_scales * math.log((STUDENT_DOF + 1) / STUDENT_DOF / STUDENT_SCALE**2) / 2
    widths = 1 / np.abs(model.evidence.hyperpriors[0].coefficients).max(axis=1)
    prior -= float(np.log(widths).sum()) - math.log(LOG_MISFIT_DEVIATION)  # all models have kappa
    return prior - loss - float(np.log(values).sum()) / 2


def joints_only_log_evidence(regression: Regression, scaling: PriorScaling) -> tuple[float, WeightedPrior]:
    """Compute the log evidence of the rigid-link model: joint compliances are the only unknowns.

    The prior of the compliances is normal, of relative deviation `JOINTS_ONLY_DEVIATION` about a common
    scale. The scale is integrated out: the readings determine it.

    Mathematics: `prior-11`.

    Args:
        regression: The reduced dataset in joint compliances.
        scaling: Prior of the joint compliances, as units pi = L x.

    Returns:
        Log evidence [1], and the wider prior, of `JOINTS_ONLY_FIT_DEVIATION`, to fit the compliances with.
    """
    scaling, n = rescale_to_data(scaling, regression), regression.structure.n_parameters
    # The prior of the compliances is fixed, so that kappa is the only hyperparameter.
    B = np.column_stack(prior_rows(scaling, PriorUncertainty(JOINTS_ONLY_DEVIATION)))
    problem = EvidenceModel(
        gram_matrices=gram_matrix(regression, scaling)[None],
        equation_counts=np.array([regression.n_equations]),
        gram_matrix_of_known_noise=B.T @ B,
        log_deviation_rows=np.zeros((n, 1)),
        expected_over_scale=np.zeros(n),
        log_scale_rows=np.zeros((n, 1)),
        hyperpriors=(
            Hyperprior(np.array([[1 / LOG_MISFIT_DEVIATION]]), np.zeros(1), normal_neg_log_density),
        ),
        bounds=np.array([[0.0], [MAX_LOG_MISFIT]]),
    )
    posterior = maximise_evidence(problem, np.zeros(1))
    # Its determinant, the common scale integrated out.
    size = 2 * n * math.log(JOINTS_ONLY_DEVIATION) + math.log(
        scaling.expected_x @ scaling.expected_x / JOINTS_ONLY_DEVIATION**2
    )
    kappa = math.exp(posterior.h[0])
    return -posterior.neg_log_evidence - size / 2, WeightedPrior(
        scaling, PriorUncertainty(JOINTS_ONLY_FIT_DEVIATION / kappa), noise_factor=kappa
    )


def _scales(model: LearntPriorModel, h: Array, covariance: Array) -> tuple[LearntScale, ...]:
    """Compute the factor of every link or joint over others of its kind, and of the joints over the links."""
    K, m = model.n_scales, len(h) - 1
    _, kinds, called = model.scaling.scale_exponents
    compliance_scales = np.flatnonzero(kinds < 2)
    rows, names = np.zeros((len(compliance_scales), m)), [called[k] for k in compliance_scales]
    rows[range(len(compliance_scales)), compliance_scales] = 1
    rows[range(len(compliance_scales)), K + model.scale_kinds[compliance_scales]] = -1
    if len(np.unique(kinds[compliance_scales])) > 1:
        rows = np.vstack([rows, (np.arange(m) == K + 1) * 1.0 - (np.arange(m) == K)])
        names.append(COMMON_JOINT_SCALE_NAME)
    deviations = np.sqrt(np.einsum("ki,ij,kj->k", rows, covariance, rows))
    factors = zip(names, np.exp(rows @ h[:m]), deviations, strict=True)
    return tuple(LearntScale(name, float(factor), float(deviation)) for name, factor, deviation in factors)


CONTRADICTION_DEVIATIONS, CONTRADICTION_FACTOR = 2.5, 2.0
"""Distance of a learnt scale from 1 that contradicts the prior: in deviations, and as a factor [1]."""
LOG_TENFOLD, REJECTING_EVIDENCE_LOSS = math.log(10), 2.0
"""Log scale that the readings should be able to reject, and the loss of log evidence that rejects it [1]."""


def contradicted_scales(weighted_prior: WeightedPrior) -> tuple[LearntScale, ...]:
    """List the learnt scales that contradict the prior: far from 1 as a factor and in standard deviations.

    Mathematics: `prior-15`.
    """

    def contradicts_prior(scale: LearntScale) -> bool:
        size = abs(math.log(scale.factor))
        return size > math.log(CONTRADICTION_FACTOR) and size > CONTRADICTION_DEVIATIONS * scale.log_deviation

    return tuple(filter(contradicts_prior, weighted_prior.learnt_scales))


@dataclass(frozen=True)
class UndeterminedCompliances:
    """List links and joints whose prior stiffness could be ten times too low or high, unseen in the data."""

    stiffer: tuple[str, ...] = ()  #: Names of links and joints that may be ten times stiffer.
    softer: tuple[str, ...] = ()  #: Names of links and joints that may be ten times softer.


def undetermined_compliances(regression: Regression, scaling: PriorScaling) -> UndeterminedCompliances:
    """Find the links and joints whose compliance the readings leave undetermined to a factor of ten.

    Mathematics: `prior-16`.

    Args:
        regression: The reduced dataset.
        scaling: Prior of the dataset's structure, as units pi = L x.

    Returns:
        Names of links and joints. With a tenfold or tenth scale of one of them, and the best scales of all
        others, the log evidence falls by less than `REJECTING_EVIDENCE_LOSS`.
    """
    model = prior_evidence_model(regression, scaling)
    best = maximise_evidence(model.evidence, model.hyperparameter_medians)
    whole = [k for k, size in enumerate(scaling.block_orders) if size == 6 or scaling.block_kinds[k] == 1]
    stiffer, softer = (
        tuple(
            scaling.block_names[k]
            for k in whole
            if _loss_at(model, best, k, sign * LOG_TENFOLD) < REJECTING_EVIDENCE_LOSS
        )
        for sign in (-1, 1)
    )
    return UndeterminedCompliances(stiffer, softer)


def _loss_at(model: LearntPriorModel, best: EvidencePosterior, k: int, size: float) -> float:
    """Compute the loss of evidence if the log scale of block k is this far from that of its kind."""
    start, kind = best.h.copy(), model.n_scales + model.scale_kinds[k]
    start[k] = best.h[kind] + size
    rejected = maximise_evidence(model.evidence, start, fixed_index=k)
    penalty, penalty_before = (
        float(student_neg_log_density((x[k] - x[kind]) / STUDENT_SCALE)[0]) for x in (rejected.h, best.h)
    )
    return rejected.neg_log_evidence - best.neg_log_evidence - penalty + penalty_before
