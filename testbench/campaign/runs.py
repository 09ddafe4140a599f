"""Measured runs for a fit: read, brought into the base's frame, poses that are held back set apart."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import Cell
from testbench.campaign.fits import Runs
from testbench.campaign.frame_choice import frame_files, registration_row, to_base
from testbench.campaign.payload import overloaded
from testbench.campaign.rows import UM
from testbench.campaign.streamed_fit import Many
from testbench.data.dataset import split
from testbench.data.read_pairs import Export, read_export
from testbench.data.spool import Campaign
from testbench.data.stream import read_campaign
from testbench.errors import BenchError, InputError
from testbench.identify.doubts import Doubt, HandedIn, doubts, open_places, scale
from testbench.identify.in_base import in_base
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.identify.registered import Registered
from testbench.model.structure import all153


class Source(Protocol):
    """What a command says about where its readings are, and how to read them."""

    @property
    def dataset(self) -> Path:
        """The file."""

    @property
    def mapping(self) -> Path | None:
        """A map of its names; None where it uses ours."""

    @property
    def sigma_um(self) -> float | None:
        """Standard deviation of a reading; None where the file says it."""

    @property
    def frame(self) -> str:
        """Frame of the readings, as of `to_base`."""

    @property
    def new_target(self) -> Sequence[str] | None:
        """Targets in the file that the arm's folder lacks."""


class Asked(Source, Protocol):
    """What a command says about its runs."""

    @property
    def check_pose(self) -> Sequence[int] | None:
        """Poses to hold back."""

    @property
    def full_pose(self) -> bool:
        """Whether orientations are insisted on."""


def files_read(asked: Source) -> list[Path]:
    """The files that are read: table, map, frames."""
    return [asked.dataset, *([asked.mapping] if asked.mapping else []), *frame_files(asked.frame)]


def read(cell: Cell, asked: Source) -> Export:
    """The runs as they were read; InputError names what is wrong with the file or its map."""
    return _loaded(asked, read_export(*_how(cell, asked)))


def _how(cell: Cell, asked: Source) -> tuple[Path, Arm, Path | None, float | None]:
    sigma = None if asked.sigma_um is None else asked.sigma_um / UM
    return asked.dataset, with_new(cell.arm, asked.new_target or ()), asked.mapping, sigma


def _loaded(asked: Source, found: Export) -> Export:
    if not found.data.wrench.any():
        raise InputError(asked.dataset, "", "expected loads, all forces and moments are 0")
    return found


def register(cell: Cell, export: Export, asked: Source) -> tuple[Cell, Registered]:
    """The cell with targets where they are, and the runs in the base's frame.

    A flag counts more than the map.

    Raises:
        InputError: When a file of frames is wrong.
        BenchError: When the frame cannot be found.
    """
    try:
        return to_base(cell, export.data, _said(export, asked))
    except InputError:
        raise
    except BenchError as err:
        doubt = open_places(cell.vjm, export.data)
        if doubt is None:
            raise
        raise BenchError(f"{err}; {doubt.sentence}") from err


def look_at(cell: Cell, export: Export, found: Registered, asked: Source) -> tuple[tuple[Doubt, ...], float]:
    """Doubts about registered runs of an arm, as its folder has it, and the factor of their deflections.

    Raises:
        InputError: When the runs are not of this arm.
    """
    prior = cad_prior(cell.arm)
    try:
        seen = doubts(HandedIn(cell.vjm, export.data, found, _said(export, asked) != "auto"), prior)
        factor = scale(found.vjm, metric(prior, found.vjm, all153(found.vjm.arm)), found.data)
    except BenchError as err:
        raise InputError(asked.dataset, "", str(err)) from err
    masses = np.linalg.norm(export.data.wrench[:, :3], axis=1) / GRAVITY
    heavy = overloaded(cell.arm, masses.tolist())
    return (*seen, *([] if heavy is None else [Doubt("payload", heavy)])), factor


def _said(export: Export, asked: Source) -> str:
    """The frame that was said, "auto" if none was."""
    return asked.frame if asked.frame != "auto" or export.frame is None else export.frame


def read_runs(cell: Cell, asked: Asked) -> tuple[Cell, Runs]:
    """The cell that was measured, and its runs: those to fit, and those in the poses held back.

    Frames and targets are found from the unloaded readings of all poses, those held back among them.

    Raises:
        InputError: When the file is wrong, or lacks the orientations that were insisted on.
        BenchError: When a pose is not in the data, none is left on one side, no target was read in those held
            back, or a frame cannot be found.
    """
    streamed = read_campaign(*_how(cell, asked))
    export = _loaded(asked, streamed.export)
    if asked.full_pose and export.data.rotation_before is None:
        problem = "expected rotation_before_*_rad, rotation_after_*_rad and sigma_rad for the rotation term"
        raise InputError(asked.dataset, "header", f"{problem} (--full-pose); it has positions only")
    filed = cell
    cell, found = register(cell, export, asked)
    doubts, factor = look_at(filed, export, found, asked)
    name, notes, frames = asked.dataset.name, (*export.notes, *found.notes), registration_row(found)
    runs = Runs(name, found.data, found.data, None, notes, frames, doubts, factor)
    if streamed.every is not None:
        return cell, replace(runs, many=_many(streamed.every, found, asked))
    if not asked.check_pose:
        return cell, runs
    try:
        check, used = split(found.data, np.array(asked.check_pose))
    except BenchError as err:
        raise BenchError(f"--check-pose: {err}") from err
    if not check.seen.any():
        poses = asked.check_pose
        raise BenchError(f"--check-pose: expected readings in pose {poses}, every target was lost there")
    return cell, replace(runs, used=used, check=check)


def _many(every: Campaign, found: Registered, asked: Asked) -> Many:
    """All runs in the base's frame, those in the poses that are held back left out of the fit."""
    if found.frame == "tracker":
        assert found.registration is not None
        every = replace(every, mend=partial(in_base, found.registration))
    poses = np.array(asked.check_pose or [], dtype=int)
    missing, used = np.setdiff1d(poses, every.pose), ~np.isin(every.pose, poses)
    if len(missing):
        count = len(np.unique(every.pose))
        raise BenchError(f"--check-pose: no pose {missing[0]} in the dataset, which has {count}")
    if not used.any():
        raise BenchError(f"--check-pose: expected runs on both sides, got {every.runs} of {every.runs}")
    return Many(every, used)


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
