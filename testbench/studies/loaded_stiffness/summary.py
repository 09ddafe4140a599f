"""The report over all poses: errors by load, truth and method, and which method is best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.rows import MM
from testbench.errors import Array
from testbench.studies.loaded_stiffness.trial import NAME, Method, PoseRow, Settings, Truth
from testbench.studies.study import Rows
from testbench.trials.spread import grouped, spread
from testbench.views.schema import Best, Column, Table, best_of, pivot

ROUNDING_MM = 1e-6  #: A method that is nowhere further off is exact: what is left is rounding.
METHODS: dict[Method, str] = {
    "linear": "Eq. (6): J C_theta J^T w, all at theta = 0",
    "secant": "Eq. (7) with K_w at theta = 0, as one stiffness for the whole load",
    "integrated": "Eq. (7) from no load to the whole: equilibrium under load",
}
NAMES: dict[Method, str] = {
    "linear": "Eq. (6)",
    "secant": "Eq. (7) once",
    "integrated": "Eq. (7) integrated",
}


@dataclass(frozen=True)
class LoadedRow:
    """Errors over all poses under one weight; percentages are of a pose's own deflection."""

    load_N: float
    truth: Truth
    method: Method
    deflection_rms_mm: float
    rms_mm: float
    max_mm: float
    vertical_rms_mm: float
    rms_percent: float
    max_percent: float
    median_mm: float
    p05_mm: float
    p95_mm: float
    median_percent: float
    p05_percent: float
    p95_percent: float

    @property
    def exact(self) -> bool:
        """Whether its error is rounding."""
        return self.rms_mm < ROUNDING_MM


@dataclass(frozen=True)
class TangentRow:
    """Largest difference of the tangent compliance under one weight, model against weightless truth [1]."""

    load_N: float
    max_relative_difference: float


@dataclass(frozen=True)
class JointsRow:
    """What joints alone leave of the heaviest weight's deflections, fitted to them without noise."""

    truth: Truth
    rms_mm: float
    rms_percent: float
    over_linear: float  #: RMS error over that of Eq. (6) with the true compliances [1].


@dataclass(frozen=True)
class LoadedReport:
    """report.json; `best` are the methods of least RMS error under the heaviest weight."""

    scenario: str
    seed: int | list[int]
    arm: str
    poses: int
    loads_N: list[float]
    methods: Mapping[Method, str]
    rows: list[LoadedRow]
    tangent: list[TangentRow]
    joints: list[JointsRow]
    best: Mapping[Truth, tuple[Method, ...]]

    def line(self, truth: Truth, method: Method) -> list[LoadedRow]:
        """Errors of a method over the weights."""
        return [row for row in self.rows if (row.truth, row.method) == (truth, method)]

    def heaviest(self, truth: Truth) -> dict[Method, LoadedRow]:
        """Errors under the heaviest weight, by method."""
        return {method: self.line(truth, method)[-1] for method in self.methods}

    def winner(self, truth: Truth) -> str:
        """The best in words."""
        return Best(tuple(NAMES[method] for method in self.best[truth]), 0.0).words


def summary(asked: Settings, seeds: range, trials: Rows[PoseRow]) -> LoadedReport:
    """Errors over the poses of all seeds."""
    every = [row for _, rows in trials for row in rows]
    cases = grouped(every, lambda row: (row.load_N, row.truth, row.method))
    rows = [statistics(*case, found) for case, found in cases.items()]
    loads = list(dict.fromkeys(row.load_N for row in rows))
    heaviest = grouped([row for row in rows if row.load_N == loads[-1]], lambda row: row.truth)
    by_load = grouped(every, lambda row: row.load_N)
    return LoadedReport(
        scenario=NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=find_arm(asked.arm).resolve().name,
        poses=asked.poses * len(seeds),
        loads_N=loads,
        methods=METHODS,
        rows=rows,
        tangent=[
            TangentRow(load, max(row.tangent_difference for row in found)) for load, found in by_load.items()
        ],
        joints=[
            joints([row for row in by_load[loads[-1]] if row.truth == truth], rows)
            for truth, rows in heaviest.items()
        ],
        best={truth: best(own) for truth, own in heaviest.items()},
    )


def joints(rows: Sequence[PoseRow], beside: Sequence[LoadedRow]) -> JointsRow:
    """Joints alone under one weight and truth; every pose stands once a method in the rows."""
    linear = next(row for row in beside if row.method == "linear")
    left = MM * rms(np.array([row.joints_error_m for row in rows if row.method == "linear"]))
    return JointsRow(linear.truth, left, 100 * left / linear.deflection_rms_mm, left / linear.rms_mm)


def best(rows: Sequence[LoadedRow]) -> tuple[Method, ...]:
    """The methods of least RMS error; what is rounding is alike."""
    return best_of({row.method: max(row.rms_mm, ROUNDING_MM) for row in rows}).names  # type: ignore[return-value]


SPREAD = ("median", "p05", "p95")


def statistics(load: float, truth: Truth, method: Method, rows: Sequence[PoseRow]) -> LoadedRow:
    """Errors over all poses, in millimetres and as a share of each pose's deflection."""
    error = np.array([row.error_m for row in rows])
    size = np.linalg.norm([row.deflection_m for row in rows], axis=1)
    distance = np.linalg.norm(error, axis=1)
    share = 100 * distance / size
    absolute, relative = spread((MM * distance).tolist()), spread(share.tolist())
    return LoadedRow(
        load_N=load,
        truth=truth,
        method=method,
        deflection_rms_mm=MM * rms(size),
        rms_mm=MM * rms(distance),
        max_mm=MM * float(distance.max()),
        vertical_rms_mm=MM * rms(error[:, 2]),
        rms_percent=100 * rms(distance) / rms(size),
        max_percent=float(share.max()),
        **{f"{name}_mm": getattr(absolute, name) for name in SPREAD},
        **{f"{name}_percent": getattr(relative, name) for name in SPREAD},
    )


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _error(key: str, heading: str) -> Column:
    return Column(f"{key}_mm", heading, "um", ".2f", scale=MM, rounding=MM * ROUNDING_MM)


def _share(key: str, heading: str) -> Column:
    return Column(f"{key}_percent", heading, "%", ".2f", rounding=1e-5)


LOAD = Column("load_N", "load", "kN", ".3g", scale=1e-3)
TRUTH = Column("truth", "arm", short="arm")
MOVES = Column("deflection_rms_mm", "deflection RMS", "mm", ".2f", short="moves\nmm")
RMS, MEDIAN, P05, P95 = (
    _error("rms", "RMS error"),
    _error("median", "median error"),
    _error("p05", "5 % of errors"),
    _error("p95", "95 % of errors"),
)
COLUMNS = (
    TRUTH,
    LOAD,
    Column("method", "method"),
    MOVES,
    *(RMS, _error("vertical_rms", "vertical RMS error"), MEDIAN, P05, P95, _error("max", "largest error")),
    *(_share("rms", "RMS error"), _share("median", "median error"), _share("p05", "5 % of errors")),
    *(_share("p95", "95 % of errors"), _share("max", "largest error")),
)
SHARE = _share("rms", "RMS error")
SHORT = {"linear": "Eq. (6)", "secant": "Eq. (7)\nonce", "integrated": "Eq. (7)\ninte-\ngrated"}
TANGENT = (LOAD, Column("max_relative_difference", "largest difference", "ppm", ".3f", scale=1e6))


def tables(report: LoadedReport) -> dict[str, Table]:
    """Every number, RMS errors side by side, and the tangents."""
    by_load = [
        {"truth": truth, "load_N": load, "linear": own["linear"], **own}
        for (truth, load), own in _side_by_side(report).items()
    ]
    side = [TRUTH, LOAD, replace(MOVES, key=f"linear.{MOVES.key}")]
    for method, name in NAMES.items():
        side.append(replace(RMS, key=f"{method}.{RMS.key}", heading=name, short=f"{SHORT[method]}\num"))
        side.append(replace(SHARE, key=f"{method}.{SHARE.key}", heading=name, short="%"))
    ordered = [row for truth in report.best for row in report.rows if row.truth == truth]
    return {
        "rows": Table(COLUMNS, ordered),
        "errors": Table(tuple(side), by_load),
        "by_load": _by_load(report),
        "tangent": Table(TANGENT, report.tangent),
    }


def _by_load(report: LoadedReport) -> Table:
    """RMS errors, a row a method and arm, a column a weight."""
    title = "RMS error of the tool's deflection by hung weight, um"
    rows = [{"method": f"{NAMES[row.method]}, {row.truth}", "row": row} for row in report.rows]
    load, error = replace(LOAD, key=f"row.{LOAD.key}"), replace(RMS, key=f"row.{RMS.key}")
    return pivot(Table((), rows, title), Column("method", "method, arm"), load, error)


def _side_by_side(report: LoadedReport) -> dict[tuple[Truth, float], dict[Method, LoadedRow]]:
    """Rows of all methods by truth and load."""
    return {
        (truth, load): {row.method: row for row in report.rows if (row.truth, row.load_N) == (truth, load)}
        for truth in report.best
        for load in report.loads_N
    }
