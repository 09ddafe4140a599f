"""Loads beyond those that a model was identified under: what it says of them is extrapolated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array
from testbench.identify.arm_model import ArmModel
from testbench.model.load import Load, resultant
from testbench.model.vjm import tool_pose

OVERLOAD = 1.5  #: Times the payload beyond which a force is said.
SLACK = 1.05  #: Up to so many times the largest load nothing is said.


@dataclass(frozen=True)
class Extent:
    """The largest loads of some poses beside those of a model's data."""

    force: float  #: Largest force in a pose, all loads together [N].
    moment: float  #: Largest moment about the tool's origin [N m].
    force_ratio: float | None  #: Over the largest that the model was identified under; None if unknown [1].
    moment_ratio: float | None  #: The same of the moment [1].
    payload_ratio: float | None  #: Of the force over the weight of the arm's payload; None if unknown [1].

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is extrapolated, with its number."""
        parts = (
            ("force", self.force, "N", self.force_ratio),
            ("moment", self.moment, "N m", self.moment_ratio),
        )
        if self.force_ratio is not None and np.isinf(self.force_ratio):
            found: tuple[str, ...] = (
                f"extrapolated: {self.force:,.0f} N, and the model was identified under own weight alone",
            )
        else:
            found = self._beyond(parts)
        if self.payload_ratio is not None and self.payload_ratio > OVERLOAD:
            found += (
                f"{self.force:,.0f} N are {self.payload_ratio:.1f} times the payload that the arm states",
            )
        return found

    @staticmethod
    def _beyond(parts: tuple[tuple[str, float, str, float | None], ...]) -> tuple[str, ...]:
        return tuple(
            f"extrapolated: {value:,.0f} {unit} are {ratio:.1f} times the largest {what} that the model was "
            f"identified under"
            for what, value, unit, ratio in parts
            if ratio is not None and ratio > SLACK
        )


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
