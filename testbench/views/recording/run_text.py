"""The words of single runs, and what the models say of themselves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.rows import MM, FitRow
from testbench.data.dataset import Dataset, Ids, Mask
from testbench.errors import Array
from testbench.views.markdown import lines
from testbench.views.schema import show


@dataclass(frozen=True)
class RunLine:
    """What is said of one run."""

    run: int  #: Its identifier.
    pose: int  #: Identifier of its pose.
    group: str  #: "identification" or "check".
    place: int  #: Its place in worst_first.
    sag_mm: float  #: Deflection of the marker that moves most.

    @property
    def where(self) -> str:
        """The run in words."""
        return f"run {self.run}, {self.group} pose {self.pose}"


def run_lines(data: Dataset, checked: Mask, rank: Ids) -> list[RunLine]:
    """One line a run, in dataset order.

    Args:
        data: The runs.
        checked: Which of them check, (runs,).
        rank: Their places in worst_first, (runs,).
    """
    sag = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
    groups = np.where(checked, "check", "identification")
    columns = (data.run, data.pose, groups, rank, sag)
    return [RunLine(*row) for row in zip(*(c.tolist() for c in columns), strict=True)]


def table(runs: Sequence[RunLine], names: Sequence[str], residual: Array) -> str:
    """All runs, in dataset order.

    Args:
        runs: Their lines.
        names: Of the models.
        residual: Residual of the worst marker, (models, runs) [m].
    """
    head = ["run", "pose", "set", "worst_first", "deflection, mm", *(f"{n}, mm" for n in names)]
    rows = [
        [str(r.run), str(r.pose), r.group, str(r.place), f"{r.sag_mm:.3f}", *(f"{x:.3f}" for x in mm)]
        for r, mm in zip(runs, MM * residual.T, strict=True)
    ]
    words = "Deflection of the marker that moves most; residual of the worst marker, for each model."
    return "\n".join(["### Every run", "", words, "", lines(head, rows)])


def captions(runs: Sequence[RunLine], names: Sequence[str], residual: Array) -> list[str]:
    """What is on screen, for every run; arguments as for `table`."""
    texts = []
    for run, column in zip(runs, MM * residual.T, strict=True):
        title = f"**{run.where.capitalize()}** sags {run.sag_mm:.2f} mm; "
        title += f"number {run.place + 1} of {len(runs)} from the worst."
        rows = lines(["worst marker", *names], [["residual, mm", *(f"{mm:.3f}" for mm in column)]])
        texts.append("\n".join([title, "", rows]))
    return texts


def load_captions(run: RunLine, share: Array, names: Sequence[str], sag: Array) -> list[str]:
    """What is on screen, for every step of loading.

    Args:
        run: The run that is loaded.
        share: Of the load, (steps,) [1].
        names: Of the shown models.
        sag: Deflection of the marker that moves most, true and by each of them, (1 + models, steps) [m].
    """
    return [
        f"**{run.where.capitalize()}** under {100 * s:.0f} % of its load: "
        + ", ".join(f"{name} {mm:.3f} mm" for name, mm in zip(["truth", *names], every, strict=True))
        for s, every in zip(share, MM * sag.T, strict=True)
    ]


def notes(models: Sequence[FitRow]) -> str:
    """Status and advice of every model."""
    texts = ["### What the models say of themselves", ""]
    for m in models:
        gap = "" if m.duality_gap is None else f", duality gap {show(m.duality_gap, '.1e')}"
        texts += [
            f"**{m.name}**: {m.method}, {m.status}{gap}, smallest eigenvalue {show(m.min_eigenvalue, '.1e')}",
            "",
            *(f"- {text}" for text in m.advice),
            "",
        ]
    return "\n".join(texts)
