"""One trial: a true arm, measured and explained by models, judged in poses that were never measured."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.absolute_truth import Truth, simulate_series
from testbench.bench.campaign import Cell, build_cell, clear_poses, hanging, stream
from testbench.bench.rows import MM
from testbench.bench.truths import FAMILY, member, true_cell
from testbench.bench.wrong_prior import wrong_prior
from testbench.data.dataset import Mask
from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.fit import Calibration, Gathered, explain, gather
from testbench.identify.absolute.intervals import deviations_root
from testbench.plant import build_plant
from testbench.studies.absolute_calibration import settings as s
from testbench.studies.absolute_calibration.beside import check, checking, judged, optimum_mm, true_unknowns

STIFF = 1e-3  #: Compliance of rigid links over what the folder says [1].
KNOWN = 1e-4  #: Standard deviation below which geometry is known [m, rad].


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


def trials(asked: s.Settings, seeds: Sequence[int]) -> list[list[FitRow]]:
    """Rows of some seeds."""
    cells = {name: build_cell(find_arm(name)) for name in asked.arms}
    return [list(_trial(cells[asked.arm_of(seed)], asked, seed)) for seed in seeds]


def _trial(cell: Cell, asked: s.Settings, seed: int) -> Iterator[FitRow]:
    for n in asked.numbers_of(seed):
        models = (*s.BY_POSES, s.WITH_LINKS) if n == asked.featured else s.BY_POSES
        yield from rows(measure(cell, Asked(s.REAL, s.ABSOLUTE, n), seed), models, optimum=True)
    for true in s.HIDING_ARMS:
        yield from rows(measure(cell, Asked(true, s.ABSOLUTE, asked.featured), seed), s.HIDING)
    for true in s.OTHER_ARMS:
        yield from rows(measure(cell, Asked(true, s.ABSOLUTE, asked.featured), seed), s.FINAL)
    for name in (s.MIXED, s.PAIRS):
        poses, loaded = (round(share * asked.featured) for share in s.CAMPAIGNS[name])
        yield from rows(measure(cell, Asked(s.REAL, name, poses, loaded), seed), s.CAMPAIGN)


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
    name, true = cell.arm.name, s.TRUE_ARMS[asked.true_arm]
    own = true_cell(cell, member(FAMILY, seed // 2), seed)
    if true.rigid_links:
        arm = own.plant.arm
        links = tuple(replace(link, compliance=STIFF * link.compliance) for link in arm.links)
        own = replace(own, truth=build_plant(replace(arm, links=links)))
    series, truth = simulate_series(own, s.campaign(name, true, asked.poses, loaded=asked.loaded), seed)
    q = clear_poses(cell, None, s.CHECKING, stream(seed, 900))
    plain = checking(series[0], truth, 0, q)
    hung = hanging(cell, q, plain.pose, s.PAYLOAD[name])
    loaded = checking(series[0], truth, 0, q, (hung.wrench, hung.point))
    gathered = gather(cell.vjm, series, wrong_prior(cell, seed), s.MODELS[s.CHOSEN])
    return Measured(asked, seed, name, truth, series, plain, loaded, gathered)


def rows(measured: Measured, models: Sequence[str], *, optimum: bool = False) -> list[FitRow]:
    """What some models make of the readings; the one of everything is among them."""
    best = optimum_mm(measured.gathered, measured.truth, measured.check) if optimum else None
    found = {name: explain(measured.gathered, s.MODELS[name]) for name in models}
    known = _known(found[s.ALL])
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
