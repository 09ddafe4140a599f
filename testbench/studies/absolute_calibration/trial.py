"""One trial: a true arm, measured and explained by models, judged in poses that were never measured."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, Truth, simulate_series
from testbench.campaign.campaign import Cell, build_cell, clear_poses, stream
from testbench.campaign.perturbed_prior import wrong_prior
from testbench.campaign.rows import MM, UM, rms
from testbench.campaign.tracker import Tracker, read_positions
from testbench.campaign.true_arms import FAMILY, member, true_cell
from testbench.data.series import Series
from testbench.data.write import series_text
from testbench.errors import Array, BenchError, Mask
from testbench.identify.absolute.fit import Calibration, explain, gather
from testbench.identify.absolute.fit import Options as Fit
from testbench.identify.absolute.posterior import inside, model_of, posterior_of, predict
from testbench.plant.build import build_plant
from testbench.plant.gear import GearErrors
from testbench.report.table import Row
from testbench.studies.absolute_calibration.beside import Held, judged, optimum_mm, registered, true_state

NAME = "absolute_calibration"
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
    return Fit(orders=ORDERS, only=frozenset(names))


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
    CHOSEN: Fit(orders=ORDERS),
}
"""Models by name; geometry, frames and mounts are on in all."""
BY_POSES = (GEOMETRY, INCUMBENT, WITH_GEARS, ALL_LS, ALL, CHOSEN)
HIDING = (INCUMBENT, WITH_GEARS, WITH_LINKS, ALL, CHOSEN)
COMPARED = (INCUMBENT, ALL)
FINAL = (INCUMBENT, ALL, CHOSEN)
DRAWN = (INCUMBENT, CHOSEN)

REAL, NO_GEARS, JOINTS_ONLY, KINDER, NASTIER = "real", "no joint errors", "rigid links", "kinder", "nastier"
TRUE_ARMS: Mapping[str, tuple[str, AbsoluteCampaign]] = {
    REAL: (
        "elastic links and joints, joint errors of 30 urad a coefficient up to order 30",
        AbsoluteCampaign(),
    ),
    NO_GEARS: (
        "the same without joint errors",
        AbsoluteCampaign(disturbances=replace(REAL_ARM, gear=None)),
    ),
    JOINTS_ONLY: ("joint errors, but links that do not bend", AbsoluteCampaign()),
    KINDER: (
        "joint errors of 10 urad up to order 10, readings of 20 um",
        AbsoluteCampaign(
            sigma=20e-6, disturbances=replace(REAL_ARM, gear=GearErrors(sigma=10e-6, orders=10))
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
                gear=GearErrors(sigma=60e-6, orders=60, ratio=1e-4),
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
class Options:
    """Flags of the study."""

    arm: Annotated[
        list[str] | None, typer.Option(help="Arm to measure; again for more, a trial each in turn.")
    ] = None


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arms: tuple[str, ...]
    numbers: tuple[int, ...]  #: Of poses.
    many: int  #: Poses that are tried in some trials; 0 for none.
    featured: int  #: Poses of everything else.
    first: int  #: The first seed, whose rows keep what is drawn.

    def arm_of(self, seed: int) -> str:
        """The arm of a trial."""
        return self.arms[seed % len(self.arms)]

    def numbers_of(self, seed: int) -> tuple[int, ...]:
        """Numbers of poses of a trial."""
        often = self.many and seed // len(self.arms) % EVERY == 0
        return (*self.numbers, self.many) if often else self.numbers


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for.

    Raises:
        BenchError: When there is no such arm, or one is there twice.
    """
    arms = tuple(options.arm or ARMS)
    for name in arms:
        if name not in PAYLOAD or arms.count(name) > 1:
            raise BenchError(f"--arm: expected different ones of {', '.join(PAYLOAD)}, got {name!r}")
    if quick:
        return Settings(arms, QUICK_NUMBERS, 0, QUICK_NUMBERS[0], seeds[0])
    return Settings(arms, NUMBERS, MANY, FEATURED, seeds[0])


@dataclass(frozen=True)
class FitRow:
    """One fit of one campaign."""

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
class Asked:
    """What is measured, and what explains it."""

    true_arm: str  #: One of TRUE_ARMS.
    campaign: str  #: One of CAMPAIGNS.
    poses: int
    models: tuple[str, ...]  #: The one of everything is among them.
    loaded: int = 0  #: How many of the poses see the payload as well.
    shown: bool = False  #: Whether rows keep the readings, and what is drawn.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[FitRow]]:
    """Rows of some seeds."""
    cells = {name: build_cell(find_arm(name)) for name in asked.arms}
    return [
        [row for one in _campaigns(asked, seed) for row in _rows(cells[asked.arm_of(seed)], one, seed)]
        for seed in seeds
    ]


def _campaigns(asked: Settings, seed: int) -> Iterator[Asked]:
    """All that is measured in a trial."""
    n = asked.featured
    for poses in asked.numbers_of(seed):
        more = (WITH_LINKS,) if poses == n else ()
        yield Asked(REAL, ABSOLUTE, poses, (*BY_POSES, *more), shown=(seed, poses) == (asked.first, n))
    for true, campaign, models in BESIDE:
        poses, loaded = (round(share * n) for share in CAMPAIGNS[campaign])
        yield Asked(true, campaign, poses, models, loaded)


def _rows(cell: Cell, asked: Asked, seed: int) -> Iterator[FitRow]:
    """Draw a true arm of the family, measure it, and judge what models make of its readings.

    The arm, its frames and its poses are the same in all that is asked of a seed.
    """
    own, (_, true) = true_cell(cell, member(FAMILY, seed // 2), seed), TRUE_ARMS[asked.true_arm]
    if asked.true_arm == JOINTS_ONLY:
        arm = own.plant.arm
        links = tuple(replace(link, compliance=STIFF * link.compliance) for link in arm.links)
        own = replace(own, truth=build_plant(replace(arm, links=links)))
    payload = PAYLOAD[cell.arm.name]
    masses = (0.0, payload) if asked.loaded else (0.0,)
    how = Row(poses=asked.poses, masses=masses, loaded_poses=asked.loaded or None)
    series, truth = simulate_series(own, true.model_copy(update=how), seed)
    q = clear_poses(cell, None, CHECKING, stream(seed, 900))
    exact = true.model_copy(update={"noise": False, "repeatability": 0.0, "outliers": 0.0})
    checks = [
        simulate_series(own, exact.model_copy(update={"masses": (mass,)}), seed, q)[0][0]
        for mass in (0.0, payload)
    ]
    gathered = gather(cell.vjm, series, wrong_prior(cell, seed), MODELS[CHOSEN])
    found = {name: explain(gathered, MODELS[name]) for name in asked.models}
    alone, known = (asked.true_arm, asked.campaign) == (REAL, ABSOLUTE), _known(found[ALL])
    about = Row(arm=cell.arm.name, true_arm=asked.true_arm, campaign=asked.campaign, poses=asked.poses)
    about |= Row(readings=sum(one.rows for one in series))
    about |= Row(optimum_mm=optimum_mm(gathered, truth, checks[0]) if alone else None)
    text = series_text(cell.arm, series, "dataset") if asked.shown else None
    for name, fit in found.items():
        row = Row(about, name=name, geometry_off=_geometry_off(fit, truth, known))
        if asked.shown and name in DRAWN:
            row |= Row(q_rad=tuple(q.ravel().tolist()), data_file=text)
        yield _row(row, fit, truth, checks, stream(seed, 901))


def _row(
    about: Row, fit: Calibration, truth: Truth, checks: Sequence[Series], rng: np.random.Generator
) -> FitRow:
    """A calibration beside the truth.

    Args:
        about: What is known of the row.
        fit: The calibration.
        truth: What it was made of.
        checks: True positions in the checking poses, under own weight and under the payload.
        rng: Source of the noise of their readings.
    """
    off, within = check(fit, checks[0], rng)
    held, joints = judged(fit, truth)
    return FitRow(
        **about,
        kept=tuple(step.name for step in fit.chosen.steps if step.kept),
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
    """Positions by a calibration beside the true ones of a series that it has, and readings of these.

    Returns:
        True position minus the model's, base axes, (rows, m, 3) [m], and which readings lie in their 95 %
        ellipsoid, (rows, m).
    """
    read = replace(true, position=read_positions(Tracker(true.sigma, None), true.position, rng))
    left, covariance = predict(model_of(calibration), registered(calibration, read), read)
    turn = calibration.state.frame(true).rotation
    return left - (read.position - true.position) @ turn, np.asarray(inside(left, covariance))


def _known(fit: Calibration) -> Array:
    """Combinations of errors of geometry that a fit knows to KNOWN, orthonormal, (k, geometry)."""
    geometry = fit.own.unknowns.columns("geometry")
    root = posterior_of(fit).root[:, np.flatnonzero(np.isin(fit.own.columns, np.r_[geometry]))]
    values, vectors = np.linalg.eigh(root.T @ root)
    return np.asarray(vectors[:, values < KNOWN**2].T)


def _geometry_off(fit: Calibration, truth: Truth, known: Array) -> float:
    """RMS error along some combinations of errors of geometry [mm, mrad]; 0 without any."""
    off = (fit.state.theta_0 - true_state(fit.state, truth).theta_0)[fit.own.unknowns.inner]
    return MM * float(np.sqrt(np.mean((known @ off) ** 2))) if len(known) else 0.0
