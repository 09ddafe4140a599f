"""All cells of one arm: noise by poses, for every structure, truth, kind of reading and prior.

A trial is a seed: poses, noise, and true arms of two kinds of the family, which take turns. Its cells share
poses, which are nested, and random numbers, so that differences between cells and methods are theirs alone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.rows import UM, DatasetRow, dataset_row
from testbench.bench.truths import TRUTHS
from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.identify import reduce
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regularised import fit_each
from testbench.model.structure import all153, joints_only, mgco47, mgco68, template56
from testbench.studies.regimes.campaigns import MEASURE, Grid, Kind
from testbench.studies.regimes.fits import with_prior, without_prior
from testbench.studies.regimes.judged import Judge

STRUCTURES = (template56, mgco47, mgco68, all153)
AT_ONCE = 2  #: Kinds of true arm in one trial.
FAMILY = ("tubes", "off_20", "off_40", "cast")
GRAVITY = Grid("kr500_l480", (4, 8, 12, 20, 40), (5e-6, 15e-6, 50e-6, 150e-6, 500e-6))
FULL_POSE = Grid("arm_6r", (2, 4, 8, 18), (25e-6, 100e-6, 400e-6))
FEATURED_POSES, FEATURED_SIGMA = 8, 50e-6  #: Of section 6: the cell whose models the report lists.
NONE = "none"
PRIORS = {"30 %": Strength(0.3), "300 %": Strength(3.0)}
"""How firmly the CAD prior is believed, by name; it is right where the truth is tubes."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    truth: Annotated[
        list[str] | None, typer.Option(help="Kind of true arm; again for more. Four kinds if not given.")
    ] = None


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    truths: tuple[str, ...] = FAMILY
    judged: int = 200  #: Poses in which the models are judged.
    gravity: Grid = GRAVITY
    full_pose: Grid = FULL_POSE

    def arms(self, seed: int) -> list[str]:
        """Kinds of true arm in a trial: neighbours in the family, so that all take turns."""
        count = len(self.truths)
        return [self.truths[(AT_ONCE * seed + k) % count] for k in range(min(AT_ONCE, count))]

    @property
    def grids(self) -> dict[Kind, Grid]:
        """By kind of reading."""
        return {"gravity": self.gravity, "full_pose": self.full_pose}


@dataclass(frozen=True)
class CellRow:
    """One structure in one cell of one arm."""

    kind: Kind  #: What is loaded and read.
    true_arm: str  #: Its kind.
    structure: str  #: Of the compared models.
    uncertainty: str  #: Of the CAD prior, the same for both, or none.
    poses: int
    sigma_um: float  #: Noise of a reading along an axis.
    ls_um: float  #: RMS error over the workspace of least squares.
    gco_um: float
    equal_um: float | None  #: Least squares, conservative if it can be at equal fit; None with a prior.
    lent_um: float | None  #: Least squares with GCO's free directions; None with a prior.
    joints_um: float  #: Joints alone, least squares without prior: the incumbent.
    ls_fitted_um: float  #: RMS error in the fitted runs, against the truth.
    gco_fitted_um: float
    conservative: bool  #: Whether least squares is.
    binds: bool  #: Whether the cone changes the fit: nothing conservative fits as well as least squares.
    taken: float  #: Chi squared a seen direction that GCO leaves beyond least squares [1].
    expected: float  #: Error that noise is expected to leave least squares, over the deflection GCO predicts.
    rank: int  #: Directions that the data see.
    free: int  #: Directions that they do not.
    solved: bool  #: Whether GCO is.
    measured: DatasetRow | None  #: The dataset, of one row a trial.


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for.

    Raises:
        BenchError: When there is no such truth, or one is there twice.
    """
    truths = tuple(options.truth or FAMILY)
    for name in truths:
        if name not in TRUTHS or truths.count(name) > 1:
            raise BenchError(f"--truth: expected different ones of {', '.join(TRUTHS)}, got {name!r}")
    found = Settings(truths)
    if not quick:
        return found
    return replace(
        found,
        judged=40,
        gravity=replace(found.gravity, poses=(4, 8, 20), sigmas=(50e-6, 150e-6)),
        full_pose=replace(found.full_pose, poses=(2, 8), sigmas=(100e-6, 400e-6)),
    )


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[CellRow]]:
    """Rows of some seeds, one a structure, truth, prior and cell of the grids."""
    cells = {kind: build_cell(find_arm(grid.arm)) for kind, grid in asked.grids.items()}
    found = []
    for seed in seeds:
        rows = [row for kind, cell in cells.items() for row in _rows(cell, kind, asked, seed)]
        measured = dataset_row(first_runs(cells["gravity"], asked, seed))
        found.append([replace(rows[0], measured=measured), *rows[1:]])
    return found


def first_runs(cell: Cell, asked: Settings, seed: int) -> Dataset:
    """The runs of the featured cell, of a trial's first arm."""
    grid = replace(asked.gravity, sigmas=(FEATURED_SIGMA,))
    [clean] = MEASURE["gravity"](cell, grid, 1, asked.arms(seed)[:1], seed)
    return clean.read(replace(grid, poses=(FEATURED_POSES,)))[0]


def _rows(cell: Cell, kind: Kind, asked: Settings, seed: int) -> Iterator[CellRow]:
    """Rows of one kind of reading."""
    grid, prior = asked.grids[kind], cad_prior(cell.arm)
    truths = asked.arms(seed)
    arms = MEASURE[kind](cell, grid, asked.judged, truths, seed)
    structures = [make(cell.arm) for make in STRUCTURES]
    for truth, clean in zip(truths, arms, strict=True):
        data, judge = clean.read(grid), Judge(cell.vjm, clean, grid)
        own = [reduce(cell.vjm, joints_only(cell.arm), runs) for runs in data]
        incumbent = judge.anywhere(fit_each(own, "none", [None] * len(own)))
        for structure in structures:
            own = [reduce(cell.vjm, structure, runs) for runs in data]
            found = {NONE: without_prior(own)}
            found |= {name: with_prior(cell.vjm, own, prior, believed) for name, believed in PRIORS.items()}
            expected = judge.expected(own)
            for name, compared in found.items():
                judged = {"joints_um": incumbent, **judge.columns(compared, expected)}
                for k, (poses, sigma) in enumerate(grid.cells):
                    yield CellRow(
                        kind=kind,
                        true_arm=truth,
                        structure=structure.name,
                        uncertainty=name,
                        poses=poses,
                        sigma_um=UM * sigma,
                        measured=None,
                        **{column: cells[k] for column, cells in judged.items()},  # type: ignore[arg-type]
                    )
