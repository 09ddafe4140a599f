"""Measured runs for a fit: read, checked, and the poses that are held back set apart."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from testbench.arm.folder import Arm
from testbench.bench.campaign import Cell
from testbench.bench.fits import Runs
from testbench.bench.frame_choice import to_base
from testbench.bench.frame_rows import registration_row
from testbench.data.csvfile import read_csv
from testbench.data.dataset import split
from testbench.errors import BenchError, InputError


class Asked(Protocol):
    """What a command says about its runs."""

    @property
    def dataset(self) -> Path:
        """The file."""

    @property
    def frame(self) -> str:
        """Frame of the readings, as of `to_base`."""

    @property
    def new_target(self) -> Sequence[str] | None:
        """Targets in the file that the arm's folder lacks."""

    @property
    def check_pose(self) -> Sequence[int] | None:
        """Poses to hold back."""

    @property
    def full_pose(self) -> bool:
        """Whether orientations are insisted on."""


def read_runs(cell: Cell, asked: Asked) -> tuple[Cell, Runs]:
    """The cell that was measured, and its runs: those to fit, and those in the poses held back.

    Frames and targets are found from the unloaded readings of all poses, those held back among them.

    Raises:
        InputError: When the file is wrong, or lacks the orientations that were insisted on.
        BenchError: When a pose is not in the data, none is left on one side, no target was read in those held
            back, or a frame cannot be found.
    """
    data = read_csv(asked.dataset, with_new(cell.arm, asked.new_target or ()))
    if asked.full_pose and data.rotation_before is None:
        problem = "expected rotation_before_*_rad, rotation_after_*_rad and sigma_rad for the rotation term"
        raise InputError(asked.dataset, "header", f"{problem} (--full-pose); it has positions only")
    cell, found = to_base(cell, data, asked.frame)
    runs = Runs(asked.dataset.name, found.data, found.data, None, found.notes, registration_row(found))
    if not asked.check_pose:
        return cell, runs
    check, used = split(found.data, np.array(asked.check_pose))
    if not check.seen.any():
        poses = asked.check_pose
        raise BenchError(f"--check-pose: expected readings in pose {poses}, every target was lost there")
    return cell, replace(runs, used=used, check=check)


def with_new(arm: Arm, names: Sequence[str]) -> Arm:
    """The arm as a reader of files knows it: with targets that it lacks.

    Raises:
        BenchError: When it has one of them, or a name is empty or comes twice.
    """
    markers = (*arm.markers, *names)
    if "" in markers or len(set(markers)) < len(markers):
        have = ", ".join(arm.markers)
        raise BenchError(f"--new-target: expected new names, got {', '.join(names)}; {arm.name} has {have}")
    return replace(arm, markers=markers)
