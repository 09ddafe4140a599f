"""What `testbench identify` tells its readers: report.json as typed rows, the unit in the name."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.explained import Elsewhere, Explained, longest
from testbench.bench.fit_rows import Fitted
from testbench.bench.rows import MM, ErrorRow
from testbench.identify import Constraint
from testbench.identify.doubts import Doubt
from testbench.identify.estimate import Estimate
from testbench.identify.identifiability import describe
from testbench.identify.prior import Strength, cad_prior
from testbench.views.identifiability.report import Seen, seen_report

USUAL = Strength(0.3)  #: Of the prior that readings are compared with, as `testbench identifiability` does.


@dataclass(frozen=True)
class ModelRow:
    """A model; its compliances are in models.json."""

    name: str
    structure: str
    constraint: Constraint
    prior: bool
    unknowns: int
    seen: int
    conservative: bool
    f_m: float
    f_m_floor: float
    fit: ErrorRow
    check: ErrorRow | None
    half_width_mm: float | None  #: Median over the predicted deflections that have a bound.


@dataclass(frozen=True)
class RunRow:
    """A run: how far its target that moves most moves, and what each model leaves at its worst one."""

    run: int
    pose: int
    held_back: bool
    deflection_mm: float
    residual_mm: dict[str, float]
    taken_mm: float  #: That of the model to take.

    @property
    def where(self) -> str:
        """The run in words."""
        return f"{self.run} (held back)" if self.held_back else str(self.run)


@dataclass(frozen=True)
class PlaceRow:
    """The tool in a pose; no half width where the readings leave it without a bound."""

    q: list[float]
    pose: str
    position_m: list[float]
    deflection_mm: float
    half_width_mm: float | None

    @property
    def where(self) -> str:
        """The tool's place in words."""
        return " ".join(f"{axis} {x:.2f}" for axis, x in zip("xyz", self.position_m, strict=True)) + " m"


@dataclass(frozen=True)
class MapRow:
    """How sure the deflection of the tool is over the workspace, 95 %."""

    force_N: float
    moment_Nm: float
    places: int
    without_bound: int
    least_mm: float | None
    median_mm: float | None
    p95_mm: float | None
    worst: PlaceRow | None  #: Of those with a bound.
    every: list[PlaceRow]


@dataclass(frozen=True)
class IdentifiedReport:
    """The fields are the keys of report.json."""

    arm: str
    dataset: str
    runs: int
    poses: int
    recommended: str
    why: str
    models: list[ModelRow]
    noise_p95_mm: float  #: Residual at the worst target of a run that noise alone exceeds in 5 %.
    residuals: list[RunRow]
    seen: Seen  #: Of the model to take.
    map: MapRow | None
    no_map: str  #: Why there is none.
    doubts: list[Doubt]
    notes: list[str]

    @property
    def taken(self) -> ModelRow:
        """The model to take."""
        return next(model for model in self.models if model.name == self.recommended)


def report_of(cell: Cell, made: Explained) -> IdentifiedReport:
    """The report of fits; `cell` has the targets that were found."""
    fits, structure = made.found.fits, made.found.taken.structure
    seen = describe(cell.vjm, structure, made.runs.used, cad_prior(cell.arm), USUAL)
    return IdentifiedReport(
        arm=fits.arm,
        dataset=fits.dataset,
        runs=fits.runs,
        poses=fits.poses,
        recommended=fits.recommended,
        why=fits.why,
        models=[_model_row(m, made.found.estimates[m.name]) for m in fits.models],
        noise_p95_mm=MM * made.noise_limit,
        residuals=_run_rows(made),
        seen=seen_report(seen),
        map=None if made.elsewhere is None else _map_row(cell, made.elsewhere),
        no_map=made.note,
        doubts=list(fits.doubts),
        notes=list(fits.notes),
    )


def _model_row(model: Fitted, estimate: Estimate) -> ModelRow:
    return ModelRow(
        name=model.name,
        structure=model.structure,
        constraint=model.constraint,
        prior=model.prior,
        unknowns=estimate.structure.n,
        seen=estimate.regression.rank,
        conservative=estimate.conservative,
        f_m=estimate.f_m,
        f_m_floor=estimate.f_m_floor,
        fit=model.identification,
        check=model.check,
        half_width_mm=None if model.intervals is None else model.intervals.half_width_mm,
    )


def _run_rows(made: Explained) -> list[RunRow]:
    data, name = made.runs.every, made.found.fits.recommended
    held = [] if made.runs.check is None else np.unique(made.runs.check.pose).tolist()
    moved = MM * longest(np.where(data.seen[..., None], data.deflection, 0.0))
    left = {key: (MM * longest(one)).tolist() for key, one in made.left.items()}
    return [
        RunRow(
            run=int(data.run[k]),
            pose=int(data.pose[k]),
            held_back=int(data.pose[k]) in held,
            deflection_mm=float(moved[k]),
            residual_mm={key: mm[k] for key, mm in left.items()},
            taken_mm=left[name][k],
        )
        for k in range(data.runs)
    ]


def _map_row(cell: Cell, found: Elsewhere) -> MapRow:
    half = MM * found.half
    known = half[np.isfinite(half)]
    places = [
        PlaceRow(
            q=found.q[k].tolist(),
            pose=cell.arm.words(found.q[k]),
            position_m=found.position[k].tolist(),
            deflection_mm=MM * float(found.deflection[k]),
            half_width_mm=float(half[k]) if np.isfinite(half[k]) else None,
        )
        for k in range(len(half))
    ]
    low, middle, most = np.quantile(known, (0, 0.5, 0.95)).tolist() if known.size else (None,) * 3
    return MapRow(
        force_N=float(np.linalg.norm(found.load.wrench[:3])),
        moment_Nm=float(np.linalg.norm(found.load.wrench[3:])),
        places=len(half),
        without_bound=len(half) - known.size,
        least_mm=low,
        median_mm=middle,
        p95_mm=most,
        worst=max(
            (row for row in places if row.half_width_mm is not None),
            key=lambda row: row.half_width_mm or 0.0,
            default=None,
        ),
        every=places,
    )
