"""What a prediction tells its readers: report.json as typed rows, the unit in the name."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.error_places import ErrorPlaces, Meaning, bounded_mm, error_places, places_at
from testbench.bench.prediction import Predicted
from testbench.bench.rows import MM
from testbench.correct.stiffness import direction_words
from testbench.errors import Array

WORST = 20  #: Poses that the report lists; predictions.csv has all.


@dataclass(frozen=True)
class PoseRow:
    """A pose: how far its loads move the tool, and how stiff the tool is there.

    None where the data of the model see nothing, or where nothing gives. Half widths are the widest along x,
    y, z. `push_mm` is how far the force of the map moves the loaded tool in its softest direction; its half
    width is that of any direction.
    """

    label: str
    line: int
    joints: str
    tool_m: list[float]
    deflection_mm: float
    deflections_mm: list[float]
    half_mm: float | None
    halves_mm: list[float | None]
    turn_mrad: float
    stiffness_n_per_um: list[float | None]
    softest: str
    softest_direction: list[float]
    push_mm: float
    push_half_mm: float | None

    @property
    def least_n_per_um(self) -> float | None:
        """Stiffness along the softest direction."""
        return self.stiffness_n_per_um[0]

    @property
    def half_words(self) -> str:
        """The half width, or that nothing was seen."""
        return "not seen" if self.half_mm is None else f"{self.half_mm:.3f}"


MOVED, HALF_WIDTH = "moved by the force", "half width, 95 %"
"""What a map tells of a place."""


@dataclass(frozen=True)
class MapRow:
    """The worst deflection under a force in any direction, over poses of the workspace."""

    force_n: float
    places: int
    median_mm: float
    p95_mm: float
    worst_mm: float
    half_mm: float | None
    unseen_percent: float
    at_m: list[float]
    joints: str
    softest: str
    errors: ErrorPlaces  #: How far the force moves the tool, the farthest first; half widths beside it.


@dataclass(frozen=True)
class PredictionReport:
    """All numbers but those of every pose, which are in predictions.csv."""

    arm: str
    absolute: bool
    method: str
    file: str
    loads: str
    poses: int
    points: list[str]
    linear: bool
    confidence_percent: float
    least_mm: float
    median_mm: float
    most_mm: float
    farthest: str
    farthest_mm: float
    unseen_percent: float
    other_off_mm: float
    position_half_mm: float | None
    force_n: float
    moment_nm: float
    force_ratio: float | None
    moment_ratio: float | None
    extrapolated: list[str]
    doubts: list[str]
    notes: list[str]
    softest: PoseRow
    worst: list[PoseRow]
    map: MapRow


def reported(made: Predicted) -> PredictionReport:
    """What there is to say of a prediction."""
    found, size = made.found, MM * made.found.size
    about, extent = made.model.about, made.extent
    point = int(size.max(axis=0).argmax())
    worst = [pose_row(made, int(k)) for k in made.worst_first[:WORST]]
    return PredictionReport(
        arm=made.model.arm.name,
        absolute=made.model.absolute,
        method=about.method,
        file=made.asked.path.name,
        loads=made.asked.words,
        poses=len(size),
        points=list(made.names),
        linear=made.linear,
        confidence_percent=100 * found.confidence,
        least_mm=float(size[:, 0].min()),
        median_mm=float(np.median(size[:, 0])),
        most_mm=float(size[:, 0].max()),
        farthest=made.names[point],
        farthest_mm=float(size[:, point].max()),
        unseen_percent=float(100 * np.isinf(found.half).any(axis=2).mean()),
        other_off_mm=float(MM * found.apart.max()),
        position_half_mm=finite(MM * np.median(found.position_half[:, 0].max(axis=1))),
        force_n=extent.force,
        moment_nm=extent.moment,
        force_ratio=finite(extent.force_ratio),
        moment_ratio=finite(extent.moment_ratio),
        extrapolated=list(extent.sentences),
        doubts=list(about.doubts),
        notes=list(made.asked.notes),
        softest=pose_row(made, int(made.stiffness.give[:, 0].argmax())),
        worst=worst,
        map=_map_row(made),
    )


def pose_row(made: Predicted, k: int) -> PoseRow:
    """A pose by its number from 0."""
    found, asked = made.found, made.asked
    direction = made.stiffness.softest[k]
    return PoseRow(
        label=asked.labels[k],
        line=int(asked.line[k]),
        joints=made.model.arm.words(asked.q[k]),
        tool_m=found.position[k, 0].tolist(),
        deflection_mm=float(MM * found.size[k, 0]),
        deflections_mm=(MM * found.deflection[k, 0]).tolist(),
        half_mm=finite(MM * found.widest[k, 0]),
        halves_mm=[finite(x) for x in MM * found.half[k, 0]],
        turn_mrad=float(1e3 * np.linalg.norm(found.turn[k])),
        stiffness_n_per_um=[finite(x) for x in 1e-6 * made.stiffness.principal[k]],
        softest=direction_words(direction),
        softest_direction=direction.tolist(),
        push_mm=float(MM * made.map.force * made.stiffness.give[k, 0]),
        push_half_mm=finite(MM * made.give_half[k].max()),
    )


def finite(value: float | None) -> float | None:
    """A number, None for infinity and none."""
    return float(value) if value is not None and np.isfinite(value) else None


def _map_row(made: Predicted) -> MapRow:
    found = made.map
    worst: Array = MM * found.worst
    k = 0  # the softest
    return MapRow(
        force_n=found.force,
        places=len(worst),
        median_mm=float(np.median(worst)),
        p95_mm=float(np.percentile(worst, 95)),
        worst_mm=float(worst[k]),
        half_mm=finite(MM * found.half[k].max()),
        unseen_percent=float(100 * np.isinf(found.half).any(axis=1).mean()),
        at_m=found.position[k].tolist(),
        joints=made.model.arm.words(found.q[k]),
        softest=direction_words(found.direction[k]),
        errors=_places(made),
    )


def _places(made: Predicted) -> ErrorPlaces:
    """The softest place first."""
    found = made.map
    at = places_at(made.model.arm, found.q, found.position, found.worst)
    values = {MOVED: bounded_mm(found.worst), HALF_WIDTH: bounded_mm(found.half.max(axis=1))}
    words = f"of the tool by {found.force:,.0f} N in the worst direction, and its half width, 95 %"
    return error_places(at, values, [MOVED], Meaning("movement", words, "median"))
