"""GCO without a prior: a fit whose trace weight is learnt over one with the same weight given."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from measure import MODELS, Row, at_most, interleave, spread

from testbench.arm.folder import Arm
from testbench.identify.method import gco
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.cell import Cell, build_cell

ARMS = "kr500_l480", "ur10", "arm_6r"
STRUCTURES = mgco68, template56, all153
BAR = 8.0  #: Of single fits.
REPEATS, SINGLE = 9, 4  #: Times that each is measured; single fits in a row, which are short.


def learnt_fits() -> list[Row]:
    """The rows of all structures on the gravity campaign of all arms, 15 runs of three markers."""
    return [row for arm in ARMS for row in rows_of(build_cell(MODELS / arm))]


def rows_of(cell: Cell) -> list[Row]:
    """A row per structure; the reduction of the dataset is part of both fits."""
    data = simulate(cell, Scenario(arm=cell.arm.name, workspace_poses=1), seed=1).identification

    def row(structure: Callable[[Arm], Structure]) -> Row:
        unknowns = structure(cell.arm)
        penalty = gco(cell.vjm, unknowns, data).penalty
        assert penalty is not None
        given = replace(gco, trace_weight=penalty.weight)
        learnt, single = interleave(
            REPEATS,
            lambda: gco(cell.vjm, unknowns, data),
            lambda: [given(cell.vjm, unknowns, data) for _ in range(SINGLE)],
        )
        single /= SINGLE
        ratio = learnt / single
        return at_most(
            f"(o) {cell.arm.name}, {unknowns.name}: GCO that learns its weight over one fit with it",
            np.median(ratio),
            "x",
            BAR,
            f"ratio {spread(ratio)}: {spread(learnt, 1e3)} over {spread(single, 1e3)} ms",
        )

    return [row(structure) for structure in STRUCTURES]
