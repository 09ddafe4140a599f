"""What `testbench identify` tells its readers: report.json as typed rows, the unit in the name."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Cell
from testbench.bench.error_places import (
    ErrorPlaces,
    Meaning,
    WorstPlace,
    bounded_mm,
    error_places,
    kept_mm,
    places_at,
)
from testbench.bench.explained import Elsewhere, Explained, longest
from testbench.bench.fit_rows import Fitted
from testbench.bench.rows import MM, ErrorRow
from testbench.identify import Constraint
from testbench.identify.doubts import Doubt
from testbench.identify.estimate import Estimate
from testbench.identify.identifiability import describe, of_regression
from testbench.identify.prior import Strength, cad_prior
from testbench.views.fits import COUNTS
from testbench.views.identifiability.report import Seen, seen_report

HALF_WIDTH = Meaning(
    "half width",
    f"of the 95 % interval of the tool's deflection, along the axis where it is widest; {COUNTS}",
    "median",
)
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
class MapRow:
    """How sure the deflection of the tool is over the workspace, 95 %; numbers are of the model to take."""

    force_N: float
    moment_Nm: float
    places: int
    without_bound: int
    least_mm: float | None
    median_mm: float | None
    p95_mm: float | None
    errors: ErrorPlaces  #: Half widths by model, deflections by the one to take.
    #: How far each other model has the tool from where the one to take has it, at the same places.
    apart_mm: dict[str, tuple[float, ...]]
    missing: tuple[str, ...]  #: Models so soft that the load finds no equilibrium.

    @property
    def bounded(self) -> bool:
        """Whether a model that is compared has a bound anywhere."""
        return any(name in self.errors.worst for name in self.errors.compared)

    @property
    def load(self) -> str:
        """The load in words."""
        return f"{self.force_N:.0f} N" + (f" and {self.moment_Nm:.0f} N m" if self.moment_Nm else "")

    @property
    def worst(self) -> WorstPlace | None:
        """Where the model to take is least sure; None where it has no bound anywhere."""
        return self.errors.worst.get(self.errors.compared[-1])


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
    fits, args = made.found.fits, (made.runs.used, cad_prior(cell.arm), USUAL)
    if made.runs.many is None:
        seen = describe(cell.vjm, made.found.taken.structure, *args)
    else:
        seen = of_regression(cell.vjm, made.found.taken.regression, *args)
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
    errors = _errors(cell, found)
    order = np.array(errors.run) - 1
    others = [name for name in found.models if name != found.taken]
    low, middle, most = np.quantile(known, (0, 0.5, 0.95)).tolist() if known.size else (None,) * 3
    return MapRow(
        force_N=float(np.linalg.norm(found.load.wrench[:3])),
        moment_Nm=float(np.linalg.norm(found.load.wrench[3:])),
        places=len(half),
        without_bound=len(half) - known.size,
        least_mm=low,
        median_mm=middle,
        p95_mm=most,
        errors=errors,
        apart_mm={name: kept_mm(found.apart(name)[order]) for name in others},
        missing=found.missing,
    )


def _errors(cell: Cell, found: Elsewhere) -> ErrorPlaces:
    """Half widths by model; joints alone are not compared: what they leave out is in no half width."""
    at = places_at(cell.arm, found.q, found.position, found.deflection)
    half = {name: bounded_mm(own.half) for name, own in found.models.items()}
    shown = [name for name in half if name != JOINTS or name == found.taken]
    return error_places(at, half, shown, HALF_WIDTH)
