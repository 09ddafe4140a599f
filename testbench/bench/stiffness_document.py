"""What model.json of an identified stiffness model holds: typed rows, the unit in the name."""

from typing import Annotated, Literal

from pydantic import Field

from testbench.arm.document import Strict
from testbench.bench.model_document import AboutRow, Document, Rows, Size


class Entry(Strict):
    """An entry of C_theta, and of its mirror where the structure is symmetric [m/N, rad/(N m), rad/N]."""

    row: str  #: Link and axis, such as link_2.phi_x, or a joint.
    column: str
    value: float


class StructureRow(Strict):
    """Which compliances were unknown, and what they are."""

    name: str
    symmetric: bool
    entries: list[Entry]


class ScaleRow(Strict):
    """How much softer than the prior the readings want a link or a joint; see `identify.metric.Scale`."""

    name: str
    factor: float
    deviation: float | None


class PriorRow(Strict):
    """The prior that counted as data; uncertainties are relative, null where the readings say all."""

    name: str
    learnt: bool  #: Whether the readings taught it.
    uncertainty: float
    scale_uncertainty: float | None
    coupling: float | None
    misfit: float  #: Noise, and what the model cannot explain, over the noise of the readings.
    scales: list[ScaleRow]


class RunsRow(Strict):
    """What was fitted."""

    runs: int
    poses: int
    held_back: list[int]  #: Poses that were not.
    rejected: int  #: Readings that the fit does without.
    sigma_m: Size
    sigma_rotation_rad: Size | None


class CertificateRow(Strict):
    """How good the fit is: the cost F_M of Eq. 19, and bounds of how far it is from the least."""

    status: str
    f_m: float
    f_m_floor: float
    duality_gap: float | None
    f_m_excess_bound: float | None


class UnseenRow(Strict):
    """What the readings cannot tell."""

    directions: int  #: Of the unknowns, without the prior.
    without_bound: int  #: Of these, such that no prior fills.
    stiffer: list[str]  #: Links and joints that may be ten times stiffer than the prior.
    softer: list[str]  #: And ten times softer.
    words: list[str]


class SpreadRow(Strict):
    """Of the distribution in posterior.npz."""

    degrees_of_freedom: (
        Annotated[float, Field(gt=0)] | None
    )  #: Of Student's distribution; null for the normal one.
    heavy_rows: Annotated[int, Field(ge=0)]  #: Last rows of root that are the prior's, of Student's.
    pull: Size
    on_boundary: bool


class StiffnessDocument(Document):
    """model.json of `testbench identify`."""

    format: Literal[1]
    kind: Literal["stiffness"]
    name: str  #: Of the model, such as ALL153 + prior.
    conservative: bool
    structure: StructureRow
    links: dict[str, Rows]  #: Compliance of every link in its beam frame.
    joints: dict[
        str, float | None
    ]  #: Of every joint; null where it is counted in that of the link before it.
    units: str  #: Of both.
    prior: PriorRow | None
    runs: RunsRow
    certificate: CertificateRow
    unseen: UnseenRow
    spread: SpreadRow
    notes: list[str]
    about: AboutRow
