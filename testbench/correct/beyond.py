"""Loads beyond those that a model was identified under: what it tells of them is extrapolated."""

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
    """The largest loads of some poses beside those of a model's data."""

    force: float  #: Largest force in a pose, all loads together [N].
    moment: float  #: Largest moment about the tool's origin [N m].
    force_ratio: float | None  #: Over the largest that the model was identified under; None if unknown [1].
    moment_ratio: float | None  #: The same of the moment [1].
    payload_ratio: float | None  #: Of the force over the weight of the arm's payload; None if unknown [1].


def extent(model: ArmModel, q: Array, loads: Sequence[Load]) -> Extent:
    """How large loads are, and how many times those of the model's data; q (poses, n) [rad, m]."""
    total = resultant(tool_pose(model.vjm, q)[1], loads)
    largest = [float(np.linalg.norm(x, axis=1).max(initial=0)) for x in np.hsplit(total, 2)]
    known = (model.about.force, model.about.moment)
    ratios = [_over(value, most) for value, most in zip(largest, known, strict=True)]
    payload = model.arm.payload
    of_payload = largest[0] / (GRAVITY * payload) if payload else None
    return Extent(largest[0], largest[1], ratios[0], ratios[1], of_payload)


def _over(value: float, known: float | None) -> float | None:
    """How many times what is known; infinite where that is nothing."""
    if known is None or not value:
        return None
    return value / known if known else math.inf
