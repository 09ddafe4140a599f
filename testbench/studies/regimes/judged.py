"""What an estimate is worth, and what may be expected of least squares beforehand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.rows import UM
from testbench.errors import Array
from testbench.identify import Estimate, reduce
from testbench.identify.evaluate import all_deflections
from testbench.identify.regression import RANK_TOLERANCE, Regression
from testbench.model.vjm import Vjm
from testbench.studies.regimes.campaigns import Clean, Grid
from testbench.studies.regimes.fits import Compared

ONE = np.sqrt(0.5)  #: Sigma of a reading at which F_M is the RMS distance itself [m].


@dataclass(frozen=True)
class Judge:
    """Judges the estimates of all cells by the truth."""

    vjm: Vjm
    clean: Clean
    grid: Grid

    def columns(self, found: Compared, expected: Array) -> dict[str, Array | Sequence[object]]:
        """What is worth telling of all fits by column of a row, a cell each.

        Args:
            found: The fits.
            expected: Error that noise is expected to leave least squares, (cells,) [um].
        """
        ranks = [estimate.regression.rank for estimate in found.ls]
        none = [None] * len(ranks)
        return {
            "ls_um": self.anywhere(found.ls),
            "gco_um": self.anywhere(found.gco),
            "equal_um": self.anywhere(found.equal) if found.equal else none,
            "lent_um": self.anywhere(found.lent) if found.lent else none,
            "ls_fitted_um": self.fitted(found.ls),
            "gco_fitted_um": self.fitted(found.gco),
            "conservative": [estimate.conservative for estimate in found.ls],
            "binds": found.binds,
            "taken": found.taken,
            "expected": expected / self.moved(found.gco),
            "rank": ranks,
            "free": [estimate.structure.n - rank for estimate, rank in zip(found.ls, ranks, strict=True)],
            "solved": [estimate.status == "solved" for estimate in found.gco],
        }

    def anywhere(self, estimates: Sequence[Estimate]) -> Array:
        """RMS error in poses never measured, of an estimate a cell, (cells,) [um]."""
        data = self.clean.judge
        error = all_deflections(self.vjm, estimates, data) - data.deflection
        return np.asarray(UM * np.sqrt(np.square(error).sum(axis=3).mean(axis=(1, 2))))

    def fitted(self, estimates: Sequence[Estimate]) -> Array:
        """RMS error in the runs that each was identified from, against the truth, (cells,) [um]."""
        data = self.clean.runs
        square = (
            np.square(all_deflections(self.vjm, estimates, data) - data.deflection).sum(axis=3).mean(axis=2)
        )
        first = [self.clean.first(poses) for poses, _ in self.grid.cells]
        return np.array([UM * np.sqrt(own[k].mean()) for own, k in zip(square, first, strict=True)])

    def moved(self, estimates: Sequence[Estimate]) -> Array:
        """RMS deflection that each predicts in poses never measured, (cells,) [um]."""
        moved = all_deflections(self.vjm, estimates, self.clean.judge)
        return np.asarray(UM * np.sqrt(np.square(moved).sum(axis=3).mean(axis=(1, 2))))

    def expected(self, regressions: Sequence[Regression]) -> Array:
        """RMS error in poses never measured that noise is expected to leave least squares, (cells,) [um].

        From rows and sigma alone; where the data leave directions free it is that of the directions seen.
        """
        structure = regressions[0].structure
        rows = reduce(self.vjm, structure, replace(self.clean.judge, sigma=ONE)).terms[0].R
        cells = self.grid.cells
        first = {poses: k for k, (poses, _) in reversed(list(enumerate(cells)))}
        once = {poses: amplified(regressions[k], rows) / cells[k][1] for poses, k in first.items()}
        return np.array([UM * once[poses] * sigma for poses, sigma in cells])


def amplified(regression: Regression, rows: Array) -> float:
    """Root of the summed variances that least squares leaves rows, (k, n) [m per unit of pi], in metres."""
    touched = regression.columns > 0
    A = np.vstack([np.sqrt(t.equations / 3) * t.R[:, touched] for t in regression.terms])
    scale = np.linalg.norm(A, axis=0)
    _, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    kept = s > RANK_TOLERANCE * s[0]
    return float(np.linalg.norm(rows[:, touched] / scale @ Vt[kept].T / s[kept]))
