"""Moves between two readings of pairs: of the tracker, or of the targets on the tool.

It is the step that `calibrate` looks for (`moves`): from one reading on all lie elsewhere than the arm says,
by a move that no error of geometry, spring or slow joint error explains.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.data.dataset import Dataset, Series, evenly, select_rows, series_of
from testbench.errors import BenchError
from testbench.identify.absolute.align import with_targets
from testbench.identify.absolute.fit import first_fit
from testbench.identify.absolute.state import ArmState, Mount, nominal_state, torque_scale
from testbench.identify.diagnosis.kinematics import ORIGIN, Issue
from testbench.identify.diagnosis.moves import (
    chance,
    most_significant_step,
    nuisance_model,
    step_places,
    with_shift,
)
from testbench.identify.metric import Prior, scale_by_prior
from testbench.model.load import weights_with_note
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm, marker_points

MAX_CHANCE = 0.05
"""Chance of a step as clear anywhere in readings without one, from which it is no doubt."""
MIN_POSES = 3  #: Poses before and behind a step that is doubted.
MAX_ORDER = 2  #: Periodic errors that may explain it: few poses tell no more.
MAX_TARGETS = 30
"""Targets that are looked at, evenly out of more: all of them move together, each has a place to be found."""
MOUNT_NAME = "targets"  #: Of the mount.


@dataclass(frozen=True)
class Timeline:
    """Hold runs in the base's frame, in order of time."""

    vjm: Vjm  #: The arm's virtual joint model, with targets as measured.
    data: Dataset  #: The runs.
    prior: Prior  #: Prior of the compliances, from the arm's folder.

    @cached_property
    def steps(self) -> list[Issue]:
        """Find what moved between two readings, at most one step per station.

        In the numbers `before` and `after`, 2 k is the unloaded reading of run k and 2 k + 1 the loaded one.
        Only steps count whose chance is below MAX_CHANCE divided by twice the number of places. The list is
        empty when there are too few readings.
        """
        series = tuple(_series_in_time(select_rows(self.data, evenly(np.arange(self.data.runs)))))
        steps = [step_places(one, MIN_POSES) for one in series]
        if not self.vjm.arm.joints or not any(map(len, steps)):
            return []
        try:
            state, noise = first_fit(
                _folder_state(self.vjm, series),
                series,
                scale_by_prior(self.prior, self.vjm, joints_only(self.vjm.arm)),
            )
        except BenchError:  # too few readings for where arm and targets are: no step can be told
            return []
        linear = nuisance_model(
            state, series, noise, scale_by_prior(self.prior, self.vjm, all153(self.vjm.arm)), MAX_ORDER
        )
        clear = MAX_CHANCE / (2 * sum(map(len, steps)))
        issues = [
            with_shift(linear, *one)
            for one in most_significant_step(linear, series, steps)
            if chance(one[1]) < clear
        ]
        return [replace(step, numbers={**step.numbers, "pairs": True}) for step in issues]


def _series_in_time(data: Dataset) -> Iterator[Series]:
    """Readings of every station in order of time, numbered 2 run unloaded and 2 run + 1 loaded.

    An unloaded reading that several loads share is one.
    """
    pose = dict(zip(data.run.tolist(), data.pose.tolist(), strict=True))
    stations = 1 if data.station is None else len(np.unique(data.station))
    for every in series_of(data, "station", MOUNT_NAME):
        series = with_targets(every, every.markers[:: -(-len(every.markers) // MAX_TARGETS)])
        loaded = np.arange(series.rows) >= series.rows // 2
        poses = np.array([pose[run] for run in series.row.tolist()])
        read = np.column_stack(
            [poses, loaded, np.where(loaded, series.pose, 0), series.position.reshape(series.rows, -1)]
        )
        first = np.unique(read, axis=0, return_index=True)[1]
        first = first[np.argsort((2 * series.pose + loaded)[first])]
        name = series.frame if stations > 1 else ""
        yield select_rows(replace(series, name=name, row=2 * series.row + loaded, pose=poses), first)


def _folder_state(vjm: Vjm, series: tuple[Series, ...]) -> ArmState:
    """The arm as its folder has it, in the base's frame."""
    weights, markers = weights_with_note(vjm.arm)[0], series[0].markers
    return replace(
        nominal_state(vjm, weights, torque_scale(vjm, weights, series)),
        frames={one.frame: ORIGIN for one in series},
        mounts={MOUNT_NAME: Mount(marker_points(vjm, markers), np.eye(3), markers)},
    )
