"""The words of a calibration's recording: what `calibration.md.j2` says of runs, models and links."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.bench.rows import MM
from testbench.views.markdown import Words
from testbench.views.recording.compliance import AXES, link_matrices, scaled
from testbench.views.recording.drawing import Drawing


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


def run_lines(drawing: Drawing) -> list[RunLine]:
    """One line a run, in dataset order."""
    sag = MM * np.linalg.norm(drawing.data.deflection, axis=-1).max(axis=1)
    groups = np.where(drawing.checked, "check", "identification")
    columns = (drawing.data.run, drawing.data.pose, groups, drawing.rank, sag, MM * drawing.residual.T)
    return [RunLine(*row) for row in zip(*(c.tolist() for c in columns), strict=True)]


def words(drawing: Drawing) -> Words:
    """The documents; of the block `run` one a RunLine, of the block `step` one a step of loading."""
    links = link_matrices(drawing)
    in_units = {link: np.array([scaled(C, found[0]) for C in found]) for link, found in links.items()}
    values = {
        "drawing": drawing,
        "runs": run_lines(drawing),
        "sag_mm": MM * drawing.sag[[0, *(1 + k for k in drawing.about.shown)]],
        "heads": drawing.heads,
        "axes": AXES,
        "links": links,
        "eigenvalues": {k: np.linalg.eigvalsh((S + S.swapaxes(1, 2)) / 2) for k, S in in_units.items()},
    }
    return Words(Path(__file__).parent, values, "calibration.md.j2")
