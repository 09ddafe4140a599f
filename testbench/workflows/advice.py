"""An estimate as the row of a table, and advice on it: what filled free directions, doubts, outliers."""

import numpy as np

from testbench.identify.conic import TIE_BREAK_WEIGHT, total_trace
from testbench.identify.estimate import Estimate, ModelAverage
from testbench.identify.prior import WeightedPrior
from testbench.identify.solve import COMPLETED_METHOD_NAME, REJECTED_RESIDUAL, TOO_MANY_OUTLIERS_CAUSE
from testbench.model.structure import PAPER_GCO_METHOD
from testbench.workflows.rows import FitRow

MISFIT = 2.0  #: F_M over its floor beyond which noise is no explanation.
MAX_REJECTED = 1 / 3  #: Share of rejected readings beyond which it is doubted that they are outliers.
MINIMUM_NORM = "in directions that no reading determines, least squares chooses the solution of minimum norm"
NEAREST = (
    "in directions that no reading determines, least squares chooses the conservative model nearest to the "
    "solution of minimum norm"
)
AVERAGED = {
    "joints_only_weight": "Joints-only",
    "joint_laws_weight": "joints with stiffening, backlash or friction",
    "joint_couplings_weight": "coupled joints",
}
"""Words for the models that an estimate may average, by the names of their weights in `ModelAverage`."""


def fit_row(name: str, estimate: Estimate, seconds: float | None, *, prior: bool = False) -> FitRow:
    """Make the row of a fit; unknowns are compliances, laws of joints aside.

    Args:
        name: Name of the model.
        estimate: The estimate.
        seconds: Time of the fit [s]; None if not measured.
        prior: Whether it was fitted with a prior.

    Returns:
        The row.
    """
    certificate, regression = estimate.certificate, estimate.compliance_regression
    return FitRow(
        name=name,
        structure=regression.structure.name,
        method=estimate.method,
        constraint=estimate.constraint,
        prior=prior,
        status=estimate.status,
        parameters=regression.structure.n_parameters,
        rank=regression.rank,
        unique=regression.rank == regression.structure.n_parameters,
        conservative=estimate.conservative,
        min_eigenvalue=estimate.min_eigenvalue,
        f_m=estimate.f_m,
        f_m_floor=estimate.f_m_floor,
        duality_gap=None if certificate is None else certificate.duality_gap,
        f_m_excess_bound=None if certificate is None else certificate.f_m_excess_bound,
        trace_bounds_rad_per_Nm=None if certificate is None else tuple(certificate.trace_bounds.tolist()),
        held_by_trace_weight=estimate.bounded_by_tie_break,
        trace_weight_Nm_per_rad=None if estimate.penalty is None else estimate.penalty.weight,
        total_trace_rad_per_Nm=total_trace(
            regression.structure, estimate.pi[: regression.structure.n_parameters]
        ),
        solve_seconds=seconds,
        advice=advice(estimate),
    )


def advice(estimate: Estimate) -> tuple[str, ...]:
    """Write notes on an estimate for a person."""
    return (
        *_of_rank(estimate),
        *_of_fit(estimate.averaged_models.links_and_joints if estimate.averaged_models else estimate),
        *_of_method(estimate),
        *of_average(estimate.averaged_models),
        *_of_outliers(estimate),
        *estimate.advice,
    )


def _of_rank(estimate: Estimate) -> list[str]:
    s, rank = estimate.compliance_regression.structure, estimate.compliance_regression.rank
    if rank == s.n_parameters:
        return []
    free = s.n_parameters - rank
    size = f"{s.name} has {s.n_parameters} unknowns and rank {rank}"
    text = f"{size}: the readings leave {free} of its {s.n_parameters} directions undetermined"
    unseen = int((estimate.compliance_regression.column_norms == 0).sum())
    return [f"{text} (unknowns that change no reading: {unseen})" if unseen else text]


def _of_fit(estimate: Estimate) -> list[str]:
    cost, floor = estimate.f_m, estimate.f_m_floor
    if cost <= MISFIT * floor:
        return []
    why = "the structure, sigma, loads, units and frame"
    return [f"{estimate.structure.name}: F_M is {cost:.3g}, but noise alone gives {floor:.3g}: check {why}"]


def _of_method(estimate: Estimate) -> list[str]:
    """What filled free directions, and what is not as it should be."""
    name, free = estimate.structure.name, estimate.regression.rank < estimate.structure.n_parameters
    if estimate.weighted_prior is not None:
        return [of_prior(estimate.weighted_prior)]
    if estimate.constraint == "psd" and estimate.certificate is not None:
        penalty = estimate.penalty
        if penalty is not None and not estimate.method.startswith(PAPER_GCO_METHOD):
            return [f"GCO: trace weight {penalty.weight:.3g} N m/rad"]
        said = [
            "in directions that no reading determines, GCO chooses the compliances of least trace "
            f"(weight {TIE_BREAK_WEIGHT:g})"
        ] * free
        if estimate.bounded_by_tie_break:
            said.append(
                f"{name}: only the trace weight limits the unobservable compliance; "
                "predictions away from the measured poses depend on it"
            )
        return said
    if estimate.method.startswith(COMPLETED_METHOD_NAME):
        return [NEAREST]
    if estimate.constraint not in ("none", "free"):
        return []
    left = estimate.constraint == "free" and estimate.status != "solved"
    return [MINIMUM_NORM] * free + [f"{name}: {estimate.status}"] * left


def of_prior(weighted_prior: WeightedPrior) -> str:
    """Say which prior filled what the data cannot see."""
    uncertainty, name = weighted_prior.uncertainty, weighted_prior.scaling.prior_name
    if uncertainty.link_coupling is not None:
        shape, coupling = (
            100 * weighted_prior.noise_factor * u for u in (uncertainty.relative, uncertainty.link_coupling)
        )
        return (
            f"the prior is {name}, with a scale for each link and joint that is estimated from the readings. "
            f"The uncertainty of the prior is {shape:.2g} % for the shape of a compliance and "
            f"{coupling:.2g} % for couplings"
        )
    scale = (
        "one common scale estimated from the readings"
        if np.isinf(uncertainty.scale)
        else f"an uncertainty of {100 * uncertainty.scale:g} % in its common scale"
    )
    return f"the prior is {name}, with an uncertainty of {100 * uncertainty.relative:.3g} % and {scale}"


def of_average(average: ModelAverage | None) -> list[str]:
    """Say which models count beside that of links and joints, with their weights; nothing where none does."""
    weights = {} if average is None else {words: getattr(average, key) for key, words in AVERAGED.items()}
    counted = ", ".join(f"{words} {100 * weight:.3g} %" for words, weight in weights.items() if weight)
    return (
        [f"the estimate is an average of models, weighted by their evidence ({counted})"] if counted else []
    )


def _of_outliers(estimate: Estimate) -> list[str]:
    """What was rejected, and whether that can still be outliers."""
    bad = len(estimate.rejected_readings)
    if not bad:
        return []
    every = bad + estimate.regression.n_equations // 3
    said = [
        f"{bad} of {every} readings are rejected: they lie beyond {REJECTED_RESIDUAL} standard deviations"
    ]
    if estimate.rejected_runs:
        runs = ", ".join(map(str, estimate.rejected_runs))
        said.append(f"all readings of run {runs} are rejected: check its load, pose and frame")
    if bad > MAX_REJECTED * every:
        said.append(f"too many to be outliers: {TOO_MANY_OUTLIERS_CAUSE}")
    return said
