"""One trial: a true arm, measured and explained by models, judged in poses that were never measured."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.catalogue import find_arm
from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, Truth, simulate_series
from testbench.campaign.campaign import Cell, build_cell, clear_poses, hanging, stream
from testbench.campaign.perturbed_prior import wrong_prior
from testbench.campaign.rows import MM
from testbench.campaign.true_arms import FAMILY, member, true_cell
from testbench.data.dataset import Mask
from testbench.data.series import Series
from testbench.errors import Array, BenchError
from testbench.identify.absolute.fit import Calibration, Gathered, explain, gather
from testbench.identify.absolute.fit import Options as Fit
from testbench.identify.absolute.intervals import deviations_root
from testbench.plant import GearErrors, build_plant
from testbench.studies.absolute_calibration.beside import check, checking, judged, optimum_mm, true_unknowns

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
CAMPAIGN = (INCUMBENT, ALL)
FINAL = (INCUMBENT, ALL, CHOSEN)


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
HIDING_ARMS = (NO_GEARS, JOINTS_ONLY)
OTHER_ARMS = (KINDER, NASTIER)

ABSOLUTE, MIXED, PAIRS = "absolute alone", "mixed", "pairs alone"
CAMPAIGNS: Mapping[str, tuple[float, float]] = {ABSOLUTE: (1.0, 0.0), MIXED: (0.75, 0.25), PAIRS: (0.5, 0.5)}
"""Poses of a campaign, and those that are measured loaded as well, over its readings."""
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

    def arm_of(self, seed: int) -> str:
        """The arm of a trial."""
        return self.arms[seed % len(self.arms)]

    def numbers_of(self, seed: int) -> tuple[int, ...]:
        """Numbers of poses of a trial."""
        often = self.many and seed // len(self.arms) % EVERY == 0
        return (*self.numbers, self.many) if often else self.numbers


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for.

    Raises:
        BenchError: When there is no such arm, or one is there twice.
    """
    arms = tuple(options.arm or ARMS)
    for name in arms:
        if name not in PAYLOAD or arms.count(name) > 1:
            raise BenchError(f"--arm: expected different ones of {', '.join(PAYLOAD)}, got {name!r}")
    return (
        Settings(arms, QUICK_NUMBERS, 0, QUICK_NUMBERS[0])
        if quick
        else Settings(arms, NUMBERS, MANY, FEATURED)
    )


@dataclass(frozen=True)
class Held:
    """Numbers that should lie in their 95 % intervals."""

    of: int
    inside: int


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


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[FitRow]]:
    """Rows of some seeds."""
    cells = {name: build_cell(find_arm(name)) for name in asked.arms}
    return [list(_trial(cells[asked.arm_of(seed)], asked, seed)) for seed in seeds]


def _trial(cell: Cell, asked: Settings, seed: int) -> Iterator[FitRow]:
    for n in asked.numbers_of(seed):
        models = (*BY_POSES, WITH_LINKS) if n == asked.featured else BY_POSES
        yield from rows(measure(cell, Asked(REAL, ABSOLUTE, n), seed), models, optimum=True)
    for true in HIDING_ARMS:
        yield from rows(measure(cell, Asked(true, ABSOLUTE, asked.featured), seed), HIDING)
    for true in OTHER_ARMS:
        yield from rows(measure(cell, Asked(true, ABSOLUTE, asked.featured), seed), FINAL)
    for name in (MIXED, PAIRS):
        poses, loaded = (round(share * asked.featured) for share in CAMPAIGNS[name])
        yield from rows(measure(cell, Asked(REAL, name, poses, loaded), seed), CAMPAIGN)


@dataclass(frozen=True)
class Asked:
    """What is measured."""

    true_arm: str  #: One of TRUE_ARMS.
    campaign: str  #: One of CAMPAIGNS.
    poses: int
    loaded: int = 0  #: How many of the poses see the payload as well.


@dataclass(frozen=True)
class Measured:
    """Readings of a true arm, gathered for fits."""

    asked: Asked
    seed: int
    arm: str
    truth: Truth
    series: tuple[Series, ...]
    check: Series  #: True positions in the checking poses.
    loaded: Series  #: The same under the payload.
    gathered: Gathered


def measure(cell: Cell, asked: Asked, seed: int) -> Measured:
    """Draw a true arm of the family, measure it, and boil its readings down.

    The arm, its frames and its poses are the same in all that is asked of a seed.
    """
    name, (_, true) = cell.arm.name, TRUE_ARMS[asked.true_arm]
    own = true_cell(cell, member(FAMILY, seed // 2), seed)
    if asked.true_arm == JOINTS_ONLY:
        arm = own.plant.arm
        links = tuple(replace(link, compliance=STIFF * link.compliance) for link in arm.links)
        own = replace(own, truth=build_plant(replace(arm, links=links)))
    masses = (0.0, PAYLOAD[name]) if asked.loaded else (0.0,)
    how = {"poses": asked.poses, "masses": masses, "loaded_poses": asked.loaded or None}
    series, truth = simulate_series(own, true.model_copy(update=how), seed)
    q = clear_poses(cell, None, CHECKING, stream(seed, 900))
    plain = checking(series[0], truth, 0, q)
    hung = hanging(cell, q, plain.pose, PAYLOAD[name])
    loaded = checking(series[0], truth, 0, q, (hung.wrench, hung.point))
    gathered = gather(cell.vjm, series, wrong_prior(cell, seed), MODELS[CHOSEN])
    return Measured(asked, seed, name, truth, series, plain, loaded, gathered)


def rows(measured: Measured, models: Sequence[str], *, optimum: bool = False) -> list[FitRow]:
    """What some models make of the readings; the one of everything is among them."""
    best = optimum_mm(measured.gathered, measured.truth, measured.check) if optimum else None
    found = {name: explain(measured.gathered, MODELS[name]) for name in models}
    known = _known(found[ALL])
    return [_row(measured, name, own, known, best) for name, own in found.items()]


def _known(own: Calibration) -> Array:
    """Combinations of errors of geometry that a fit knows to KNOWN, orthonormal, (k, geometry)."""
    geometry = own.own.unknowns.columns("geometry")
    root = deviations_root(own)[np.flatnonzero(np.isin(own.own.columns, np.r_[geometry]))]
    values, vectors = np.linalg.eigh(root @ root.T)
    return np.asarray(vectors[:, values < KNOWN**2].T)


def _row(measured: Measured, name: str, own: Calibration, known: Array, optimum: float | None) -> FitRow:
    asked, rng = measured.asked, stream(measured.seed, 901)
    error, within = check(own, measured.check, rng)
    parts = judged(own, measured.truth)
    held = {part: _held(*one) for part, one in parts.items()}
    _, joints = parts.get("joint compliances", (None, np.zeros(0)))
    return FitRow(
        arm=measured.arm,
        true_arm=asked.true_arm,
        campaign=asked.campaign,
        poses=asked.poses,
        readings=sum(one.rows for one in measured.series),
        name=name,
        kept=tuple(step.name for step in own.chosen.steps if step.kept),
        error_mm=_rms_mm(error),
        loaded_mm=_rms_mm(check(own, measured.loaded, rng)[0]),
        optimum_mm=optimum,
        positions=Held(within.size, int(within.sum())),
        geometry=held.get("geometry"),
        joint_errors=held.get("joint errors"),
        joints=held.get("joint compliances"),
        entries=held.get("entries"),
        compliance_off=tuple(joints.tolist()),
        geometry_off=_geometry_off(own, measured.truth, known),
    )


def _held(inside: Mask, relative: Array) -> Held | None:
    """Those that the truth has, such as joint errors of its orders; None where it has none."""
    there = np.isfinite(relative)
    return Held(int(there.sum()), int(inside[there].sum())) if there.any() else None


def _rms_mm(error: Array) -> float:
    return MM * float(np.sqrt(np.mean(np.square(error))))


def _geometry_off(own: Calibration, truth: Truth, known: Array) -> float:
    """RMS error along some combinations of errors of geometry [mm, mrad]; 0 without any."""
    unknowns = own.own.unknowns
    off = own.state.theta_0[unknowns.inner] - true_unknowns(unknowns, truth)[unknowns.columns("geometry")]
    return MM * float(np.sqrt(np.mean((known @ off) ** 2))) if len(known) else 0.0
