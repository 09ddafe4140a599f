"""Absolute readings of simulated arms: which errors hide behind which, how many poses, what pairs add.

A trial is a true arm, measured and explained by models, judged in poses that were never measured.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.data.dataset import Series
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.files.write import series_text
from testbench.identify.absolute import evidence
from testbench.identify.absolute.align import Noise, unknowns_of
from testbench.identify.absolute.evidence import (
    ErrorScales,
    activate_unknowns,
    gram_of_active_unknowns,
    solve_active_unknowns,
)
from testbench.identify.absolute.fit import (
    Calibration,
    LinearisedReadings,
    linearise_readings,
    posterior_of_calibration,
    select_and_solve,
)
from testbench.identify.absolute.fit import CalibrationOptions as Fit
from testbench.identify.absolute.posterior import RegisteredSeries, inside_ellipsoid, predict_series
from testbench.identify.absolute.state import ArmState, with_error_terms
from testbench.identify.equations import series_equations
from testbench.identify.posterior import Posterior
from testbench.identify.prior import Prior, PriorUncertainty, scale_by_prior
from testbench.identify.registration import SQUARED_LOSS
from testbench.identify.regression import Linearisation, reduce_series
from testbench.model.kinematics import JointErrorTerms
from testbench.model.structure import all153
from testbench.model.vjm import Vjm
from testbench.plant.build import build_plant
from testbench.plant.disturbance import GearErrors
from testbench.plant.tracker import IsotropicTracker, read_positions
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.report import colours
from testbench.report.badge import of_rivals
from testbench.report.colours import CHOICE, Look, look
from testbench.report.figure import Figure, forest, sweeps
from testbench.report.markdown import Markdown, listed
from testbench.report.report import Report, lines, say
from testbench.report.scene import PageContent
from testbench.report.schema import Table, columns, pivot
from testbench.report.table import Row, Trials, number
from testbench.runs.rows import trial_rng
from testbench.runs.spread import MIN_PERCENTILE_TRIALS, span, spread
from testbench.studies.campaigns import seeds_of
from testbench.studies.run import FEW, READ, headline
from testbench.studies.study import Run, Study, amid_errors
from testbench.workflows.absolute_campaign import REAL_ARM, AbsoluteCampaign, Truth, simulate_series
from testbench.workflows.calibration_numbers import joint_compliances
from testbench.workflows.campaign import true_cell
from testbench.workflows.cell import Cell, build_cell, clear_poses
from testbench.workflows.models import wrong_prior
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import MM, UM, rms

# --- A calibration beside the truth behind its readings: its numbers, positions, and the least error --------

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
    vjm = state.vjm
    theta = truth.theta_0.copy()
    gears = truth.arm.gear_errors
    theta[_before(vjm)[1:]] += vjm.joint_axes_in_beam_frame[1:] * theta[6 * len(vjm.arm.links) + 1 :, None]
    theta_0 = state.theta_0.copy()
    n = np.zeros_like(state.error_coefficients)
    orders = np.array(state.error_terms.orders, dtype=int)
    inner = slice(6, 6 * vjm.arm.n_joints)
    theta_0[inner] = theta[inner]
    if gears is not None:
        there = np.flatnonzero(orders <= len(gears.sine))
        n[:, there] = gears.sine[orders[there] - 1].T
        n[:, len(orders) + there] = gears.cosine[orders[there] - 1].T
        if state.error_terms.ratio:
            n[:, 2 * len(orders)] = gears.ratio_error
    return replace(state, theta_0=theta_0, error_coefficients=n, C_theta=truth.C_theta)


def _before(vjm: Vjm) -> Ids:
    """Turns of the link before every joint, of a slide its shifts, among the virtual joints, (n, 3)."""
    first = [6 * k + (0 if joint.prismatic else 3) for k, joint in enumerate(vjm.arm.joints)]
    return np.array(first)[:, None] + np.arange(3)


def _true_joints(vjm: Vjm, truth: Truth) -> Array:
    """Compute the true compliance of every joint with that of the link before it about its axis.

    Args:
        vjm: Kinematics of the arm.
        truth: The true arm and how it was measured.

    Returns:
        Compliance, (n,) [rad/(N m), m/N].
    """
    at, C = _before(vjm), truth.C_theta
    links = np.einsum(
        "na,nab,nb->n",
        vjm.joint_axes_in_beam_frame,
        C[at[:, :, None], at[:, None]],
        vjm.joint_axes_in_beam_frame,
    )
    return np.asarray(np.diag(C)[6 * len(vjm.arm.links) :] + links)


def _score_intervals(calibration: Calibration, truth: Truth) -> tuple[dict[str, Held], Array]:
    """Compare all numbers of a calibration that have an interval with the truth.

    A joint's true compliance has that of the link before it about its axis, of a rigid model's links too.

    Args:
        calibration: The calibration.
        truth: The true arm and how it was measured.

    Returns:
        Of each part those numbers that the truth has, where there are some: joint errors have its orders. Of
        the compliances of the joints found over true, less one, (n,); (0,) of a rigid model.
    """
    active, unknowns = calibration.active_unknowns, calibration.active_unknowns.unknowns
    known = posterior_of_calibration(calibration)
    parts = {}
    relative = np.zeros(0)
    true = unknowns.values(true_state(calibration.state, truth))
    every, all_columns = np.eye(unknowns.size), np.arange(unknowns.size)
    functionals = {
        name: every[np.intersect1d(all_columns[unknowns.columns(kind)], active.columns)]
        for name, kind in (("geometry", "geometry"), ("joint errors", "errors"), ("entries", "elastic"))
    }
    if active.compliance_prior is not None:
        functionals["joint compliances"] = np.array([row for *_, row in joint_compliances(active)])
    for part, rows in functionals.items():
        a, sought = rows[:, active.columns], rows @ true
        if part == "joint compliances":
            sought = _true_joints(unknowns.vjm, truth)
            relative = a @ known.mean / sought - 1
        inside = (np.abs(a @ known.mean - sought) < known.half_widths(a))[sought != 0]
        if inside.size:
            parts[part] = Held(inside.size, int(inside.sum()))
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
    errors = JointErrorTerms(
        tuple(range(1, 1 + (disturbances.gear_errors.max_order if disturbances.gear_errors else 0)))
    )
    unknowns = unknowns_of(vjm, found.series, errors, all153(vjm.arm))
    kinds = evidence.GEOMETRY_ERROR_KINDS | ({"harmonics"} if errors.orders else frozenset())
    active = activate_unknowns(
        unknowns, kinds, scale_by_prior(Prior("truth", truth.C_theta), vjm, unknowns.structure)
    )
    true = true_state(with_error_terms(found.state, errors), truth)
    reduced = reduce_series(Linearisation(unknowns, true, Noise(), SQUARED_LOSS), found.series)
    sizes = {
        "geometry shift": disturbances.geometry.position_sigma,
        "geometry turn": float(
            np.hypot(disturbances.geometry.angle_sigma, disturbances.joint_offset_sigma / np.sqrt(3))
        ),
        "harmonics": disturbances.gear_errors.sigma if disturbances.gear_errors else 0.0,
    }
    deviation = np.full(unknowns.size, np.inf)
    for kind, own in unknowns.prior_groups:
        deviation[own] = sizes[kind]
    known = ErrorScales(deviation, np.ones(len(reduced.kinds)))
    V = solve_active_unknowns(
        active, gram_of_active_unknowns(active, reduced.total_gram_matrices), known, PriorUncertainty(SHAPE)
    ).covariance
    assert active.compliance_prior is not None
    lines = series_equations(unknowns, true, check)[:, :, active.columns].transpose(0, 1, 3, 2)
    A = lines.reshape(-1, len(active.columns))
    A = np.hstack([A[:, : active.n_rigid], A[:, active.n_rigid :] @ active.compliance_prior.L])
    return MM * float(np.sqrt(3 * np.einsum("ec,cd,ed->e", A, V, A).mean()))


def _with_frame_of(calibration: Calibration, series: Series) -> RegisteredSeries:
    """Take the joint posterior of arm, frame and mount of a series from a calibration.

    `register_with_known_frame`, for a model without these, approximates it: there, repeated readings of a
    pose do not share the model error.
    """
    unknowns, every = (
        calibration.active_unknowns.unknowns,
        np.arange(calibration.active_unknowns.unknowns.size),
    )
    names = f"frame {series.frame}", f"mount {series.mount}"
    # all frames and mounts are selected, before the arm's unknowns
    at = np.concatenate([every[unknowns.columns(name)] for name in names])
    at = np.r_[at, np.flatnonzero(calibration.active_unknowns.columns >= unknowns.first_columns["geometry"])]
    whole = posterior_of_calibration(calibration)
    return RegisteredSeries(
        calibration.state,
        np.zeros(0, dtype=int),
        Posterior.from_covariance_root(whole.mean[at], whole.covariance_root[:, at]),
    )


# --- Absolute readings of simulated arms: which errors hide behind which, how many poses, what pairs add ----

NAME = "absolute_calibration"
BY = ("arm", "true_arm", "campaign", "poses", "name")  #: What a row of the report is of.
PARTS = ("positions", "geometry", "joint_errors", "joints", "entries")  #: Of what should lie in its interval.
BY_NUMBER = "name arm poses trials error_mm over_optimum " + " ".join(
    f"inside.{part}_percent" for part in PARTS
)
CASES = (
    "name arm true_arm campaign poses error_mm loaded_mm bias_2_percent off_2_percent bias_3_percent "
    "off_3_percent geometry_off inside.joints_percent gears_kept_percent links_kept_percent"
)
OPTIMUM = "noise-only optimum"
ARMS = ("ur10", "kr500_l480")  #: A seed each in turn.
PAYLOAD: Mapping[str, float] = {"ur10": 10.0, "kr500_l480": 460.3}
"""Mass that is hung in loaded poses [kg]."""
NUMBERS = (20, 50, 100, 200, 500)  #: Poses that are tried.
MANY, EVERY = 1000, 4  #: Poses that are tried in every so manieth trial of an arm.
FEATURED = 200  #: Poses of everything else.
CHECKING = 100  #: Poses that predictions are judged in.
QUICK, QUICK_NUMBERS = 2, (20,)  #: With --quick: trials at most, and poses.

ORDERS = 40  #: Periodic errors that are tried: the joints have 30, as a rule.


def _fit(*names: str) -> Fit:
    return Fit(max_order=ORDERS, used_errors=frozenset(names))


SPRINGS, GEARS, LINKS = "joint springs", "joint errors", "links"
GEOMETRY = "geometry alone"
INCUMBENT = "joint springs"
WITH_GEARS, WITH_LINKS = "joint springs, joint errors", "joint springs, links"
ALL_LS, ALL = "all, least squares", "all, GCO"
CHOSEN = "chosen by cross-validation"
MODELS: Mapping[str, Fit] = {
    GEOMETRY: _fit(),
    INCUMBENT: _fit(SPRINGS),
    WITH_GEARS: _fit(SPRINGS, GEARS),
    WITH_LINKS: _fit(SPRINGS, LINKS),
    ALL_LS: replace(_fit(SPRINGS, GEARS, LINKS), constraint="none"),
    ALL: _fit(SPRINGS, GEARS, LINKS),
    CHOSEN: Fit(max_order=ORDERS),
}
"""Models by name; geometry, frames and mounts are on in all."""
LOOKS = {
    GEOMETRY: Look(colours.GREY, 0, prior=False),
    INCUMBENT: Look(colours.JOINTS, 1, prior=False),
    WITH_GEARS: Look(colours.JOINTS_PRIOR, 2, prior=False),
    WITH_LINKS: look("ALL153", "psd", prior=True),
    ALL_LS: Look(colours.LEAST_SQUARES, 3, prior=True),
    ALL: Look(colours.GCO, 4, prior=True),
    CHOSEN: CHOICE,
    OPTIMUM: Look(colours.TASK, 0, prior=True),
}
BY_POSES = (GEOMETRY, INCUMBENT, WITH_GEARS, ALL_LS, ALL, CHOSEN)
HIDING = (INCUMBENT, WITH_GEARS, WITH_LINKS, ALL, CHOSEN)
COMPARED = (INCUMBENT, ALL)
FINAL = (INCUMBENT, ALL, CHOSEN)
DRAWN = (INCUMBENT, ALL_LS, ALL, CHOSEN)

REAL, NO_GEARS, JOINTS_ONLY, KINDER, NASTIER = "real", "no joint errors", "rigid links", "kinder", "nastier"
TRUE_ARMS: Mapping[str, tuple[str, AbsoluteCampaign]] = {
    REAL: (
        "elastic links and joints, joint errors of 30 urad a coefficient up to order 30",
        AbsoluteCampaign(),
    ),
    NO_GEARS: (
        "the same without joint errors",
        AbsoluteCampaign(disturbances=replace(REAL_ARM, gear_errors=None)),
    ),
    JOINTS_ONLY: ("joint errors, but links that do not bend", AbsoluteCampaign()),
    KINDER: (
        "joint errors of 10 urad up to order 10, readings of 20 um",
        AbsoluteCampaign(
            sigma=20e-6, disturbances=replace(REAL_ARM, gear_errors=GearErrors(sigma=10e-6, max_order=10))
        ),
    ),
    NASTIER: (
        "joint errors of 60 urad up to order 60, gear ratios 0.01 % off, joints that stiffen and have play "
        "and hysteresis, 10 urad of scatter between approaches, 2 % of the readings 2 mm off",
        AbsoluteCampaign(
            repeatability=10e-6,
            outliers=0.02,
            disturbances=replace(
                REAL_ARM,
                gear_errors=GearErrors(sigma=60e-6, max_order=60, ratio_sigma=1e-4),
                stiffening=0.1,
                backlash=5e-5,
                hysteresis=3e-5,
            ),
        ),
    ),
}
"""True arms in words, and how they are measured; the first is that of everything else."""

ABSOLUTE, MIXED, PAIRS = "absolute alone", "mixed", "pairs alone"
CAMPAIGNS: Mapping[str, tuple[float, float]] = {ABSOLUTE: (1.0, 0.0), MIXED: (0.75, 0.25), PAIRS: (0.5, 0.5)}
"""Poses of a campaign, and those that are measured loaded as well, over its readings."""
BESIDE: Sequence[tuple[str, str, tuple[str, ...]]] = (
    (NO_GEARS, ABSOLUTE, HIDING),
    (JOINTS_ONLY, ABSOLUTE, HIDING),
    (KINDER, ABSOLUTE, FINAL),
    (NASTIER, ABSOLUTE, FINAL),
    (REAL, MIXED, COMPARED),
    (REAL, PAIRS, COMPARED),
)
"""What else is measured in a trial: a true arm, a campaign, and the models that explain it."""
STIFF = 1e-3  #: Compliance of rigid links over what the folder says [1].
KNOWN = 1e-4  #: Standard deviation below which geometry is known [m, rad].


@dataclass(frozen=True)
class AbsoluteOptions:
    """Hold the flags of the study."""

    arm: Annotated[
        list[str] | None, typer.Option(metavar="ARM", help="Arm to measure; repeatable: arms take turns.")
    ] = None


@dataclass(frozen=True)
class AbsoluteSettings:
    """Describe what is tried."""

    arms: tuple[str, ...]
    numbers: tuple[int, ...]  #: Of poses.
    many: int  #: Poses that are tried in some trials; 0 for none.
    featured: int  #: Poses of everything else.
    first: int  #: The first seed, whose rows keep what is drawn.

    def arm_of(self, seed: int) -> str:
        """Return the arm of a trial."""
        return self.arms[seed % len(self.arms)]

    def numbers_of(self, seed: int) -> tuple[int, ...]:
        """Return the numbers of poses of a trial."""
        often = self.many and seed // len(self.arms) % EVERY == 0
        return (*self.numbers, self.many) if often else self.numbers


def _settings(options: AbsoluteOptions, quick: bool, seeds: range) -> AbsoluteSettings:
    """Make the settings of the flags."""
    arms = tuple(options.arm or ARMS)
    for name in arms:
        if name not in PAYLOAD or arms.count(name) > 1:
            raise BenchError(f"--arm: expected some of {', '.join(PAYLOAD)}, each once, got {name!r}")
    if quick:
        return AbsoluteSettings(arms, QUICK_NUMBERS, 0, QUICK_NUMBERS[0], seeds[0])
    return AbsoluteSettings(arms, NUMBERS, MANY, FEATURED, seeds[0])


@dataclass(frozen=True)
class AbsoluteFitRow:
    """Hold one fit of one campaign."""

    arm: str
    true_arm: str  #: One of TRUE_ARMS.
    campaign: str  #: One of CAMPAIGNS.
    poses: int
    readings: int
    name: str  #: Of the model, one of MODELS.
    kept: tuple[str, ...]  #: Errors that cross-validation kept, where it chose.
    error_mm: float  #: RMS distance of predicted from true positions in the checking poses, own weight.
    loaded_mm: float  #: The same under the payload.
    optimum_mm: float | None  #: RMS distance that is expected when the sizes of all errors are known.
    positions: Held  #: Readings in the checking poses.
    geometry: Held | None
    joint_errors: Held | None  #: None where the model has none.
    joints: Held | None  #: Compliances of the joints.
    entries: Held | None  #: Entries of C_theta.
    #: Compliance of every joint, with the link before, found over true less one; empty of a rigid model.
    compliance_off: tuple[float, ...]
    #: RMS error of geometry along the combinations of its errors that the fit of everything knows [mm, mrad].
    geometry_off: float
    #: Checking poses, (poses * n,) [rad], and true minus predicted positions there under own weight, base
    #: axes, (poses * m * 3,) [um]; of what is drawn of the first trial.
    q_rad: tuple[float, ...] | None = None
    off_um: tuple[float, ...] | None = None
    data_file: str | None = None  #: dataset.csv of the first trial; the same.


@dataclass(frozen=True)
class AbsoluteTrial:
    """Describe what is measured, and what explains it."""

    true_arm: str  #: One of TRUE_ARMS.
    campaign: str  #: One of CAMPAIGNS.
    poses: int
    models: tuple[str, ...]  #: The one of everything is among them.
    loaded: int = 0  #: How many of the poses see the payload as well.
    shown: bool = False  #: Whether rows keep the readings, and what is drawn.


def _cells(asked: AbsoluteSettings) -> dict[str, Cell]:
    """Build the arms that are measured, by name."""
    return {name: build_cell(find_arm(name)) for name in asked.arms}


def _trial(
    arms: Mapping[str, Cell], asked: AbsoluteSettings, seed: int, _: Models
) -> Iterator[AbsoluteFitRow]:
    """Make the rows of a seed."""
    for measured in _campaigns(asked, seed):
        yield from _rows(arms[asked.arm_of(seed)], measured, seed)


def _campaigns(asked: AbsoluteSettings, seed: int) -> Iterator[AbsoluteTrial]:
    """All that is measured in a trial."""
    n = asked.featured
    for poses in asked.numbers_of(seed):
        more = (WITH_LINKS,) if poses == n else ()
        yield AbsoluteTrial(
            REAL, ABSOLUTE, poses, (*BY_POSES, *more), shown=(seed, poses) == (asked.first, n)
        )
    for true, campaign, models in BESIDE:
        poses, loaded = (round(share * n) for share in CAMPAIGNS[campaign])
        yield AbsoluteTrial(true, campaign, poses, models, loaded)


def _rows(cell: Cell, asked: AbsoluteTrial, seed: int) -> Iterator[AbsoluteFitRow]:
    """Draw a true arm of the family, measure it, and judge what models make of its readings.

    The arm, its frames and its poses are the same in all that is asked of a seed.
    """
    own, (_, true) = (
        true_cell(cell, true_arm_of_seed(FAMILY_NAME, seed // 2), seed),
        TRUE_ARMS[asked.true_arm],
    )
    if asked.true_arm == JOINTS_ONLY:
        arm = own.plant.arm
        links = tuple(replace(link, compliance=STIFF * link.compliance) for link in arm.links)
        own = replace(own, truth=build_plant(replace(arm, links=links)))
    payload = PAYLOAD[cell.arm.name]
    masses = (0.0, payload) if asked.loaded else (0.0,)
    how = Row(poses=asked.poses, masses=masses, loaded_poses=asked.loaded or None)
    series, truth = simulate_series(own, true.model_copy(update=how), seed)
    q = clear_poses(cell, None, CHECKING, trial_rng(seed, 900))
    exact = true.model_copy(update={"noise": False, "repeatability": 0.0, "outliers": 0.0})
    checks = [
        simulate_series(own, exact.model_copy(update={"masses": (mass,)}), seed, q)[0][0]
        for mass in (0.0, payload)
    ]
    gathered = linearise_readings(cell.vjm, series, wrong_prior(cell, seed), MODELS[CHOSEN])
    found = {name: select_and_solve(gathered, MODELS[name]) for name in asked.models}
    alone, known = (asked.true_arm, asked.campaign) == (REAL, ABSOLUTE), _known(found[ALL])
    about = Row(arm=cell.arm.name, true_arm=asked.true_arm, campaign=asked.campaign, poses=asked.poses)
    about |= Row(readings=sum(one.n_rows for one in series))
    about |= Row(optimum_mm=optimum_mm(gathered, truth, checks[0]) if alone else None)
    text = series_text(cell.arm, series, "dataset") if asked.shown else None
    for name, fit in found.items():
        row = Row(about, name=name, geometry_off=_geometry_off(fit, truth, known))
        if asked.shown and name in DRAWN:
            row |= Row(q_rad=tuple(q.ravel().tolist()), data_file=text)
        yield _row(row, fit, truth, checks, trial_rng(seed, 901))


def _row(
    about: Row, fit: Calibration, truth: Truth, checks: Sequence[Series], rng: np.random.Generator
) -> AbsoluteFitRow:
    """A calibration beside the truth.

    Args:
        about: What is known of the row.
        fit: The calibration.
        truth: What it was made of.
        checks: True positions in the checking poses, under own weight and under the payload.
        rng: Source of the noise of their readings.
    """
    off, within = check(fit, checks[0], rng)
    held, joints = _score_intervals(fit, truth)
    return AbsoluteFitRow(
        **about,
        kept=tuple(step.name for step in fit.selection.steps if step.kept),
        error_mm=MM * rms(off),
        loaded_mm=MM * rms(check(fit, checks[1], rng)[0]),
        positions=Held(within.size, int(within.sum())),
        geometry=held.get("geometry"),
        joint_errors=held.get("joint errors"),
        joints=held.get("joint compliances"),
        entries=held.get("entries"),
        compliance_off=tuple(joints.tolist()),
        off_um=tuple(np.round(UM * off, 2).ravel().tolist()) if "q_rad" in about else None,
    )


def check(calibration: Calibration, true: Series, rng: np.random.Generator) -> tuple[Array, Mask]:
    """Compare positions by a calibration with the true ones of a series that it has.

    Args:
        calibration: The calibration.
        true: Series with true positions.
        rng: Source of randomness.

    Returns:
        True position minus the model's, base axes, (rows, m, 3) [m], and which readings lie in their 95 %
        ellipsoid, (rows, m).
    """
    read = replace(true, position=read_positions(IsotropicTracker(true.sigma, None), true.position, rng))
    left, covariance = predict_series(calibration.model(), _with_frame_of(calibration, read), read)
    turn = calibration.state.frame(true).rotation
    inside = inside_ellipsoid(left, covariance, read.chi_squared_95)
    return left - (read.position - true.position) @ turn, inside


def _known(fit: Calibration) -> Array:
    """Combinations of errors of geometry that a fit knows to KNOWN, orthonormal, (k, geometry)."""
    geometry = fit.active_unknowns.unknowns.columns("geometry")
    root = posterior_of_calibration(fit).covariance_root[
        :, np.flatnonzero(np.isin(fit.active_unknowns.columns, np.r_[geometry]))
    ]
    values, vectors = np.linalg.eigh(root.T @ root)
    return np.asarray(vectors[:, values < KNOWN**2].T)


def _geometry_off(fit: Calibration, truth: Truth, known: Array) -> float:
    """RMS error along some combinations of errors of geometry [mm, mrad]; 0 without any."""
    off = (fit.state.theta_0 - true_state(fit.state, truth).theta_0)[
        fit.active_unknowns.unknowns.geometry_slice
    ]
    return MM * float(np.sqrt(np.mean((known @ off) ** 2))) if len(known) else 0.0


def _report(asked: AbsoluteSettings, seeds: range, trials: Trials) -> Report:
    """Report by arm, true arm, campaign, number of poses and model."""
    f = _numbers(asked, seeds, trials)
    own = _by_poses(f)
    featured = [row for row in own if row.poses == asked.featured]
    cases = [row for row in f.models if row.readings == asked.featured and row.name in HIDING]
    badge = of_rivals(
        trials.where(poses=asked.featured, true_arm=REAL, campaign=ABSOLUTE),
        CHOSEN,
        [name for name in MODELS if name != CHOSEN],
        "error_mm",
        f"trial of {listed(f.arms)}",
    )
    name, error = columns("name error_mm")
    each = [
        Table((name, replace(error, heading=f"error on {arm}")), [row for row in featured if row.arm == arm])
        for arm in f.arms
    ]
    title = f"RMS error where nothing was measured, {asked.featured} poses, own weight, mm"
    return Report(
        scenario=NAME,
        question=Markdown(
            "Which errors can absolute readings not separate? How many poses are enough? What do loaded "
            "pairs add?"
        ),
        title=say(
            "{trials:counted trial} of {arms:list} in turn, {featured} poses, noise {dataset.sigma_um:g} um",
            f,
        ),
        answer=lines(headline(badge, table) for table in each),
        claims=[FEW] if len(seeds) < MIN_PERCENTILE_TRIALS else [],
        numbers=f,
        tables={
            "short": replace(pivot(Table((), featured, title), *columns("name arm error_mm")), looks=LOOKS),
            "models": Table(columns(BY_NUMBER), own, "errors by number of poses", looks=LOOKS),
            "cases": Table(columns(CASES), cases, "other true arms and campaigns", looks=LOOKS),
        },
        body=["short", "models", "cases", READ],
        badge=badge,
    )


def _numbers(asked: AbsoluteSettings, seeds: range, trials: Trials) -> Row:
    """All numbers of report.json."""
    arms = [arm for arm in asked.arms if arm in trials.values("arm")]
    places = {name: trials.values(name) for name in BY} | {"arm": arms, "name": [*MODELS]}
    rows = [_merged(Row(zip(BY, key, strict=True)), own) for key, own in trials.groups(*BY)]
    rows.sort(key=lambda row: [places[name].index(row[name]) for name in BY])
    return Row(
        seed=seeds_of(seeds),
        trials=len(seeds),
        arms=arms,
        featured=asked.featured,
        true_arms={name: words for name, (words, _) in TRUE_ARMS.items()},
        models=rows,
        dataset=Row(runs=asked.featured, points=asked.featured, sigma_um=UM * TRUE_ARMS[REAL][1].sigma),
    )


def _merged(key: Row, own: Trials) -> Row:
    """What a model makes of some true arms and a campaign, over their trials."""
    row = Row(key, trials=len(own), inside=Row())
    row["readings"] = number(own["readings"])
    for name in ("error_mm", "loaded_mm", "optimum_mm", "geometry_off"):
        row[name] = None if np.isnan(own[name]).any() else spread(own[name])
    known = row.optimum_mm is not None
    row["over_optimum"] = _root(own["error_mm"] / own["optimum_mm"]) if known else None
    for part in PARTS:
        count, within = (np.nansum(own[f"{part}.{name}"].astype(float)) for name in ("of", "inside"))
        row.inside[f"{part}_percent"] = 100 * within / count if count else None
    for name, part in (("gears", GEARS), ("links", LINKS)):
        share = 100 * np.mean([part in kept for kept in own["kept"]])
        row[f"{name}_kept_percent"] = share if key.name == CHOSEN else None
    off = 100 * np.array([cells[1:3] for cells in own["compliance_off"]])
    for joint, shares in zip((2, 3), off.T, strict=False):  # none of a rigid arm
        row[f"bias_{joint}_percent"] = float(np.median(shares))
        row[f"off_{joint}_percent"] = _root(shares)
    return row


def _root(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _by_poses(f: Row) -> list[Row]:
    """Rows of real arms that were measured absolutely, by number of poses."""
    alike = (REAL, ABSOLUTE)
    return [row for row in f.models if (row.true_arm, row.campaign) == alike and row.name in BY_POSES]


def _figures(found: Report) -> dict[str, Figure]:
    """Draw the error by number of poses of every arm; of one number the errors alone."""
    f, short = Row(found.numbers), found.tables["short"]
    title = f"Error where nothing was measured, {f.featured} poses"
    reading = (
        f"RMS errors under own weight, {f.dataset.sigma_um:g} um a reading, medians of {f.trials} trials"
    )
    rows = _by_poses(f)
    if len({row.poses for row in rows}) == 1:
        name, *arms = short.columns
        error = [replace(column, heading="RMS error", unit="mm") for column in arms]
        titles, short = (
            {column.key: column.heading for column in arms},
            replace(short, columns=(name, *error)),
        )
        return {f"{NAME}.png": forest(short, titles, title, f"{reading}.")}
    best = [Row(row, name=OPTIMUM, error_mm=row.optimum_mm) for row in rows if row.name == ALL]
    drawn = {name: LOOKS[name] for name in (INCUMBENT, ALL, CHOSEN, OPTIMUM)}
    panes = {
        arm: Table(
            columns("name poses error_mm"), [row for row in (*rows, *best) if row.arm == arm], looks=drawn
        )
        for arm in f.arms
    }
    return {f"{NAME}.png": sweeps(panes, title, f"{reading}; bands: {span(f.trials)}.")}


def _seen(run: Run[AbsoluteSettings]) -> PageContent:
    """Draw the first trial's arm amid the errors of joint springs and of what cross-validation chose."""
    cell, rows = build_cell(find_arm(run.settings.arm_of(run.seeds[0]))), run.first
    rows = rows.pick(np.array([own is not None for own in rows["q_rad"]]))
    q = np.reshape(rows["q_rad"][0], (-1, cell.arm.n_joints))
    off = {
        name: np.reshape(own, (len(q), -1, 3))[:, 0] / UM
        for name, own in zip(rows["name"], rows["off_um"], strict=True)
    }
    return amid_errors(cell, q, [str(k + 1) for k in range(len(q))], off, LOOKS)


STUDY = Study(
    name=NAME,
    about="Calibrate simulated arms by absolute readings: which quantities hide each other, how many poses "
    "are enough, and what loaded readings add.",
    options=AbsoluteOptions,
    settings=_settings,
    seeds=(100, QUICK),
    arms=lambda asked: [find_arm(name) for name in asked.arms],
    row=AbsoluteFitRow,
    trial=_trial,
    shared=_cells,
    report=_report,
    printed=("short",),
    figures=_figures,
    write=_seen,
)
