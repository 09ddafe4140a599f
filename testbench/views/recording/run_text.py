"""The words of a calibration's recording: what `calibration.md.j2` says of places, runs, models and links."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.bench.rows import MM
from testbench.views.markdown import Words
from testbench.views.recording.compliance import AXES, link_matrices, scaled
from testbench.views.recording.drawing import Drawing, over_markers


@dataclass(frozen=True)
class RunLine:
    """What is said of one run."""

    run: int  #: Its identifier.
    pose: int  #: Identifier of its pose.
    group: str  #: "identification" or "check".
    place: int  #: Its place in worst_first.
    sag_mm: float  #: Deflection of the marker that moves most.
    residual_mm: list[float]  #: Residual of the worst marker, by model.

    @property
    def where(self) -> str:
        """The run in words."""
        return f"run {self.run}, {self.group} pose {self.pose}"


@dataclass(frozen=True)
class PlaceLine:
    """What is said of one place of the workspace."""

    place: int  #: Its place on the timeline.
    position_m: tuple[float, ...]  #: x, y and z of the tool.
    joints: str  #: Joint angles for people.
    sag_mm: float  #: True deflection, RMS over the markers.
    error_mm: list[float]  #: By shown model.
    worst_of: list[str]  #: Shown models that err most here.


def run_lines(drawing: Drawing) -> list[RunLine]:
    """One line a run, in dataset order."""
    sag = MM * np.linalg.norm(drawing.data.deflection, axis=-1).max(axis=1)
    groups = np.where(drawing.checked, "check", "identification")
    columns = (drawing.data.run, drawing.data.pose, groups, drawing.rank, sag, MM * drawing.residual.T)
    return [RunLine(*row) for row in zip(*(c.tolist() for c in columns), strict=True)]


def place_lines(drawing: Drawing) -> list[PlaceLine]:
    """One line a place, where the compared models differ most first."""
    found, names = drawing.about.map, drawing.heads[1:]
    worst = {name: found.worst[name].place for name in names}
    errors = zip(*(found.errors(name).tolist() for name in names), strict=True)
    columns = (found.position_m, found.joints, found.deflection_mm, errors)
    return [
        PlaceLine(k, position, joints, sag, list(mm), [name for name in names if worst[name] == k])
        for k, (position, joints, sag, mm) in enumerate(zip(*columns, strict=True))
    ]


def words(drawing: Drawing) -> Words:
    """The documents; of `run`, `place` and `step` one a RunLine, a PlaceLine and a step of loading."""
    links = link_matrices(drawing)
    in_units = {link: np.array([scaled(C, found[0]) for C in found]) for link, found in links.items()}
    loading, shown = drawing.loading, list(drawing.about.shown)
    values = {
        "drawing": drawing,
        "map": drawing.about.map,
        "runs": run_lines(drawing),
        "sag_mm": MM * over_markers(np.stack([loading.deflection, *loading.predicted[shown]])),
        "heads": drawing.heads,
        "axes": AXES,
        "links": links,
        "eigenvalues": {k: np.linalg.eigvalsh((S + S.swapaxes(1, 2)) / 2) for k, S in in_units.items()},
    }
    return Words(Path(__file__).parent, values, "calibration.md.j2")
