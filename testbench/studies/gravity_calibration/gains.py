"""What the model to take gains over the others, and where it errs most: by errors over the workspace."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from testbench.bench.baselines import JOINTS, gain
from testbench.bench.truths import CALLED
from testbench.studies.gravity_calibration.trial import ModelRow
from testbench.trials.gain import Gain
from testbench.trials.spread import Number, merge, middle

ByName = Mapping[str, Sequence[ModelRow]]
"""Rows of all seeds by model."""


@dataclass(frozen=True)
class Gains:
    """RMS errors over the workspace, against the truth; None where a model is not there."""

    least_squares: Gain | None  #: The model to take beside the best least squares without prior.
    joints: Gain | None  #: The same beside joints alone.
    same_prior: Gain | None  #: The same beside the best least squares with the prior.
    best: Gain | None  #: The same beside the recommended model.
    gco: Gain | None  #: The best GCO without prior beside the best least squares without prior.
    gco_joints: Gain | None  #: The same beside joints alone.


@dataclass(frozen=True)
class Worst:
    """The true arm with which the model to take errs most: RMS errors over the workspace."""

    true_arm_is: str  #: In few words.
    take_mm: Number
    joints_mm: Number
    least_squares_mm: Number


def gains(by_name: ByName, take: str, best: str, least: tuple[str, str, str]) -> Gains:
    """The model to take beside the others.

    Args:
        by_name: Rows of all seeds by model.
        take: The model to take.
        best: What is recommended.
        least: The best of least squares without prior, of least squares with it, of GCO without prior.
    """
    least_squares, same_prior, gco = least
    return Gains(
        least_squares=gain(by_name, take, least_squares),
        joints=gain(by_name, take, JOINTS),
        same_prior=gain(by_name, take, same_prior),
        best=gain(by_name, take, best),
        gco=gain(by_name, gco, least_squares),
        gco_joints=gain(by_name, gco, JOINTS),
    )


def worst(by_name: ByName, arms: Sequence[str], names: tuple[str, str, str]) -> Worst | None:
    """The true arm of the largest median error; None with one true arm, or no model to take.

    Args:
        by_name: Rows of all seeds by model.
        arms: Names of the true arms.
        names: The model to take, joints alone, least squares.
    """
    if len(arms) == 1 or names[0] not in by_name:
        return None
    of_arm = {arm: [_there(by_name.get(name, ()), arm) for name in names] for arm in arms}
    arm = max(arms, key=lambda name: middle(of_arm[name][0]))
    return Worst(CALLED[arm], *of_arm[arm])


def _there(rows: Sequence[ModelRow], arm: str) -> Number:
    own = [row.workspace.rms_mm for row in rows if row.true_arm == arm]
    return merge(own) if own else None
