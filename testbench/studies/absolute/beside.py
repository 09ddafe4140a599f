"""A calibration beside the truth behind its readings: its numbers, positions, and the least error."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.identify.absolute import choose
from testbench.identify.absolute.evidence import ErrorScales, activate, gram_of_active, solve_active
from testbench.identify.absolute.fit import Calibration, LinearisedReadings
from testbench.identify.absolute.posterior import RegisteredSeries, posterior_of
from testbench.identify.absolute.scatter import Noise
from testbench.identify.absolute.state import ArmState
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.fold import Linearisation, reduce_series
from testbench.identify.metric import scale_by_prior
from testbench.identify.posterior import Posterior
from testbench.identify.prior import Prior, Strength
from testbench.identify.robust_loss import SQUARE
from testbench.identify.rows import series_rows
from testbench.model.joint_errors import JointErrors
from testbench.model.structure import all153
from testbench.model.vjm import Vjm
from testbench.workflows.absolute_truth import Truth
from testbench.workflows.named_parameters import Part, functionals
from testbench.workflows.rows import MM

SHAPE = 0.3  #: How well compliances are known beside a common factor, standard deviation [1].


@dataclass(frozen=True)
class Held:
    """Count numbers that should lie in their 95 % intervals."""

    of: int
    inside: int


def true_state(state: ArmState, truth: Truth) -> ArmState:
    """Give a state the true values of all its errors; its frames and mounts stay.

    A joint's offset is a turn of the link before it about its axis, as in the model.

    Args:
        state: The calibrated arm.
        truth: The true arm and how it was measured.

    Returns:
        The state.
    """
    vjm, theta, gears = state.vjm, truth.theta_0.copy(), truth.gears
    theta[_before(vjm)[1:]] += vjm.beam_axes[1:] * theta[6 * len(vjm.arm.links) + 1 :, None]
    theta_0, n, orders = (
        state.theta_0.copy(),
        np.zeros_like(state.n),
        np.array(state.errors.orders, dtype=int),
    )
    inner = slice(6, 6 * vjm.arm.n_joints)
    theta_0[inner] = theta[inner]
    if gears is not None:
        there = np.flatnonzero(orders <= len(gears.sine))
        n[:, there] = gears.sine[orders[there] - 1].T
        n[:, len(orders) + there] = gears.cosine[orders[there] - 1].T
        if state.errors.ratio:
            n[:, 2 * len(orders)] = gears.ratio
    return replace(state, theta_0=theta_0, n=n, C_theta=truth.C_theta)


def _before(vjm: Vjm) -> Ids:
    """Turns of the link before every joint, of a slide its shifts, among the virtual joints, (n, 3)."""
    first = [6 * k + (0 if joint.prismatic else 3) for k, joint in enumerate(vjm.arm.joints)]
    return np.array(first)[:, None] + np.arange(3)


def true_joints(vjm: Vjm, truth: Truth) -> Array:
    """Compute the true compliance of every joint with that of the link before it about its axis.

    Args:
        vjm: Kinematics of the arm.
        truth: The true arm and how it was measured.

    Returns:
        Compliance, (n,) [rad/(N m), m/N].
    """
    at, C = _before(vjm), truth.C_theta
    links = np.einsum("na,nab,nb->n", vjm.beam_axes, C[at[:, :, None], at[:, None]], vjm.beam_axes)
    return np.asarray(np.diag(C)[6 * len(vjm.arm.links) :] + links)


def score_intervals(calibration: Calibration, truth: Truth) -> tuple[dict[Part, Held], Array]:
    """Compare all numbers of a calibration that have an interval with the truth.

    A joint's true compliance has that of the link before it about its axis, of a rigid model's links too.

    Args:
        calibration: The calibration.
        truth: The true arm and how it was measured.

    Returns:
        Of each part those numbers that the truth has, where there are some: joint errors have its orders. Of
        the compliances of the joints found over true, less one, (n,); (0,) of a rigid model.
    """
    active, known, parts, relative = calibration.active, posterior_of(calibration), {}, np.zeros(0)
    true = active.unknowns.current(true_state(calibration.state, truth))
    for group in functionals(active):
        a, sought = group.of[:, active.columns], group.of @ true
        if group.part == "joint compliances":
            sought = true_joints(active.unknowns.vjm, truth)
            relative = a @ known.x / sought - 1
        inside = (np.abs(a @ known.x - sought) < known.half_widths(a))[sought != 0]
        if inside.size:
            parts[group.part] = Held(inside.size, int(inside.sum()))
    return parts, relative


def optimum_mm(found: LinearisedReadings, truth: Truth, check: Series) -> float:
    """Compute the expected RMS distance from the true positions of the best linear estimate, at the truth.

    It knows the standard deviations that geometry, joint errors and noise were drawn with, which orders the
    joint errors have, and compliances to SHAPE around the true ones, and has no other errors to look for.

    Args:
        found: The readings, linearised.
        truth: The true arm and how it was measured.
        check: Series that judges.

    Returns:
        Distance [mm].
    """
    vjm, disturbances = found.state.vjm, truth.arm.disturbances
    assert disturbances.geometry is not None
    errors = JointErrors(tuple(range(1, 1 + (disturbances.gear.orders if disturbances.gear else 0))))
    unknowns = unknowns_of(vjm, found.series, errors, all153(vjm.arm))
    kinds = choose.GEOMETRY | ({"harmonics"} if errors.orders else frozenset())
    active = activate(unknowns, kinds, scale_by_prior(Prior("truth", truth.C_theta), vjm, unknowns.structure))
    nothing = np.zeros((vjm.arm.n_joints, errors.size))
    true = true_state(replace(found.state, errors=errors, n=nothing), truth)
    reduced = reduce_series(Linearisation(unknowns, true, Noise(), SQUARE), found.series)
    sizes = {
        "geometry shift": disturbances.geometry.position,
        "geometry turn": float(
            np.hypot(disturbances.geometry.angle, disturbances.sensor_offset / np.sqrt(3))
        ),
        "harmonics": disturbances.gear.sigma if disturbances.gear else 0.0,
    }
    deviation = np.full(unknowns.size, np.inf)
    for kind, columns in unknowns.groups:
        deviation[columns] = sizes[kind]
    known = ErrorScales(deviation, np.ones(len(reduced.kinds)))
    V = solve_active(active, gram_of_active(active, reduced.gram), known, Strength(SHAPE)).covariance
    assert active.elastic is not None
    lines = series_rows(unknowns, true, check)[:, :, active.columns].transpose(0, 1, 3, 2)
    A = lines.reshape(-1, len(active.columns))
    A = np.hstack([A[:, : active.rigid], A[:, active.rigid :] @ active.elastic.L])
    return MM * float(np.sqrt(3 * np.einsum("ec,cd,ed->e", A, V, A).mean()))


def registered(calibration: Calibration, series: Series) -> RegisteredSeries:
    """Register a series by frame and mount as the calibration left them.

    Args:
        calibration: The calibration.
        series: A series of absolute readings.

    Returns:
        The series with the covariance of its frame and mount.
    """
    active, every = calibration.active, np.arange(calibration.active.unknowns.size)
    calibration.state.frame(series), calibration.state.mount(series)
    names = f"frame {series.frame}", f"mount {series.target}"
    # all frames and mounts are on
    at = np.concatenate([every[active.unknowns.columns(name)] for name in names])
    at = np.r_[at, np.flatnonzero(active.columns >= active.unknowns.starts["geometry"])]
    whole = posterior_of(calibration)
    return RegisteredSeries(
        calibration.state, np.zeros(0, dtype=int), Posterior.normal(whole.x[at], whole.root[:, at])
    )
