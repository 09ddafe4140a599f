"""What the study's trials return: numbers of a model, trained on some readings and judged on others."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.absolute_model import belief_of
from testbench.bench.rows import MM
from testbench.data.series import select_rows
from testbench.errors import Array
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.posterior import Placed, evenly, inside, known, place, predict
from testbench.identify.absolute.scatter import residuals
from testbench.studies.real_ur10.readings import Judged

INTERVALS = 250  #: Positions, evenly spaced, whose 95 % ellipsoids are worked out.


@dataclass(frozen=True)
class Error:
    """Distances of positions that were not fitted from a model."""

    n: int
    mean_mm: float
    rms_mm: float
    p95_mm: float
    p99_mm: float
    max_mm: float
    coverage_95: float  #: Share of some positions inside their 95 % ellipsoid [1].


@dataclass(frozen=True)
class LadderRow:
    """A model of the ladder; its numbers as the readings that trained it made them."""

    split: str
    model: str
    judged: str | None  #: Series that judges it; None of the row that says what the model is.
    error: Error | None
    left_um: tuple[
        float, ...
    ]  #: Readings minus model of all judged rows, base axes, (3 rows,); of some models.
    poses: int  #: That trained it.
    method: str | None  #: How compliances were found; None of a rigid arm.
    parameters: int  #: Unknowns of the arm, frames and targets not counted.
    conservative: bool
    min_eigenvalue: float  #: Smallest of a block of the compliances [m/N, rad/(N m)].
    duality_gap: float | None
    joints: tuple[float, ...]  #: Compliances of the joints, (n,) [rad/(N m)].
    waves: tuple[float, ...]  #: Coefficients of periodic errors, joint by joint, sines then cosines [rad].
    kept: tuple[str, ...]  #: Errors that cross-validation kept, and declined.
    declined: tuple[str, ...]


@dataclass(frozen=True)
class SubsetRow:
    """A model trained on random poses of C, judged on poses of C that it never saw, or on A."""

    poses: int
    model: str
    judged: str
    mean_mm: float
    p95_mm: float
    p99_mm: float
    max_mm: float
    coverage_95: float


def placed(found: Calibration, judged: Judged) -> Placed:
    """The frame and target of readings that judge a model."""
    belief, series = belief_of(found), judged.series
    if judged.frame_poses is None:
        return known(found.state, belief, series)
    return place(found.state, belief, series, evenly(series, judged.frame_poses))


def left(at: Placed, judged: Judged) -> Array:
    """Readings minus model in base axes, those that told frame and target left out, (rows, 3) [m]."""
    every = residuals(at.state, judged.series)[0].T
    return np.asarray(np.delete(every, at.rows, axis=0))


def judge(found: Calibration, at: Placed, judged: Judged, off: Array) -> Error:
    """Distances of readings from a model, `off` being what is `left`, and how many lie where it was sure."""
    far = MM * np.linalg.norm(off, axis=1)
    rest = np.setdiff1d(np.arange(judged.series.rows), at.rows)
    some = rest[np.linspace(0, len(rest) - 1, min(len(rest), INTERVALS)).astype(int)]
    within = inside(predict(at, belief_of(found), select_rows(judged.series, some)))
    p95, p99 = np.percentile(far, [95, 99])
    return Error(
        n=len(far),
        mean_mm=float(far.mean()),
        rms_mm=float(np.sqrt((far**2).mean())),
        p95_mm=float(p95),
        p99_mm=float(p99),
        max_mm=float(far.max()),
        coverage_95=float(within.mean()),
    )
