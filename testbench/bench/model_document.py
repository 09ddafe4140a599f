"""What every model.json says, whatever the kind of model: typed rows, the unit in the name."""

from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field

from testbench.arm.document import Strict
from testbench.correct.arm_model import About
from testbench.errors import Array
from testbench.model.load import Load, resultant
from testbench.model.vjm import Vjm, tool_pose
from testbench.model.weights import Weights

LARGEST = 1e12  #: Of a model's numbers, whatever the unit: squares of products of them are finite.
LONGEST, NAME = 20_000, 255
"""Longest text of a model, and longest name of its arm [characters]."""
PRINTED = (
    "^[^\\x00-\\x1f\\x7f-\\x9f\\u2028\\u2029]*$"  #: Texts without control characters, which no XML holds.
)
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
MOST, MOST_TEXTS = 100_000, 1000  #: Numbers of a list, and texts.
Numbers = Annotated[list[Number], Field(max_length=MOST)]
Rows = Annotated[list[Numbers], Field(max_length=MOST)]
Texts = Annotated[list[str], Field(max_length=MOST_TEXTS)]
Size = Annotated[float, Field(ge=0, le=LARGEST)]


class Row(Strict):
    """A part of model.json, perhaps a stranger's: no text of it fills a page."""

    model_config = ConfigDict(str_max_length=LONGEST)


class Head(Strict):
    """What tells one kind of model from another."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")

    kind: str
    format: int


class WeightsRow(Row):
    """Masses and centres of all bodies."""

    mass_kg: list[Size]
    centre_m: Rows


class AboutRow(Row):
    """Where a model comes from."""

    method: str
    #: SHA-256 of every file of readings, by its name.
    data: Annotated[dict[str, str], Field(max_length=MOST_TEXTS)]
    doubts: Texts
    force_N: Size | None
    moment_Nm: Size | None
    versions: dict[str, str]


class Document(Row):
    """What all kinds have."""

    kind: str
    format: int
    arm: Annotated[str, Field(max_length=NAME, pattern=PRINTED)]
    digests: dict[str, str]
    weights: WeightsRow
    posterior: str | None = None  #: SHA-256 of posterior.npz.
    checksum: str | None = None  #: Of all the rest, see `bench.model_seal`.


def weights_row(weights: Weights) -> WeightsRow:
    """Masses and centres as a row."""
    return WeightsRow(mass_kg=weights.mass.tolist(), centre_m=weights.centre.tolist())


def loaded_by(vjm: Vjm, q: Array, load: Load) -> tuple[float, float]:
    """Largest force [N] and largest moment about the tool's origin [N m] over some poses, (poses, n)."""
    total = resultant(tool_pose(vjm, q)[1], [load])
    return float(np.linalg.norm(total[:, :3], axis=1).max()), float(
        np.linalg.norm(total[:, 3:], axis=1).max()
    )


def about_of(row: AboutRow) -> About:
    """Where a model comes from."""
    return About(row.method, tuple(row.data), tuple(row.doubts), row.force_N, row.moment_Nm)
