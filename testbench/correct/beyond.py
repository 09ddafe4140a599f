"""Extrapolation: how far loads exceed those under which a model was identified."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array
from testbench.identify.arm_model import ArmModel
from testbench.model.load import Load, resultant
from testbench.model.vjm import tool_pose


@dataclass(frozen=True)
class Extent:
    """Hold the largest loads of some poses, and their ratios to those of the model's data."""

    force: float  #: Largest force in a pose, all loads together [N].
    moment: float  #: Largest moment about the tool's origin [N m].
    force_ratio: float | None  #: Largest force over that of the model's data [1]; None if unknown.
    moment_ratio: float | None  #: Largest moment over that of the model's data [1]; None if unknown.
    payload_ratio: float | None  #: Largest force over the weight of the rated payload [1]; None if unknown.


def extent(model: ArmModel, q: Array, loads: Sequence[Load]) -> Extent:
    """Compute the largest force and moment over some poses, and their ratios to those of the model's data.

    Mathematics: `cor-7`.

    Args:
        model: The model, with the largest loads of its data where these are known.
        q: Actuated joints, (poses, n) [rad, m].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Sizes and ratios; a ratio is None where the data's load is unknown or there is no load.

    Raises:
        BenchError: When q has another shape or is not finite, or a load has rows for another number of poses.
    """
    total = resultant(tool_pose(model.vjm, q)[1], loads)
    largest = [float(np.linalg.norm(x, axis=1).max(initial=0)) for x in np.hsplit(total, 2)]
    known = (model.about.force, model.about.moment)
    ratios = [_over(value, most) for value, most in zip(largest, known, strict=True)]
    payload = model.arm.payload
    of_payload = largest[0] / (GRAVITY * payload) if payload else None
    return Extent(largest[0], largest[1], ratios[0], ratios[1], of_payload)


def _over(value: float, known: float | None) -> float | None:
    """Divide by what is known; infinite where that is zero, None where nothing is known or to be divided."""
    if known is None or not value:
        return None
    return value / known if known else math.inf
