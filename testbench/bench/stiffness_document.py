"""What model.json of an identified stiffness model holds: typed rows, the unit in the name."""

from typing import Annotated, Literal

from pydantic import Field

from testbench.bench.model_document import LARGEST, AboutRow, Document, Number, Row, Rows, Size, Texts


class Entry(Row):
    """An entry of C_theta, and of its mirror where the structure is symmetric [m/N, rad/(N m), rad/N]."""

    row: str  #: Link and axis, such as link_2.phi_x, or a joint.
    column: str
    value: Number


class StructureRow(Row):
    """Which compliances were unknown, and what they are."""

    name: str
    symmetric: bool
    entries: list[Entry]


class ScaleRow(Row):
    """How much softer than the prior the readings want a link or a joint; see `identify.metric.Scale`."""

    name: str
    factor: Number
    deviation: Number | None


class PriorRow(Row):
    """The prior that counted as data; uncertainties are relative, null where the readings say all."""

    name: str
    learnt: bool  #: Whether the readings taught it.
    uncertainty: Number
    scale_uncertainty: Number | None
    coupling: Number | None
    misfit: Number  #: Noise, and what the model cannot explain, over the noise of the readings.
    scales: list[ScaleRow]


class RunsRow(Row):
    """What was fitted."""

    runs: int
    poses: int
    held_back: list[int]  #: Poses that were not.
    rejected: int  #: Readings that the fit does without.
    sigma_m: Size
    sigma_rotation_rad: Size | None


class CertificateRow(Row):
    """How good the fit is: the cost F_M of Eq. 19, and bounds of how far it is from the least."""

    status: str
    f_m: Number
    f_m_floor: Number
    duality_gap: Number | None
    f_m_excess_bound: Number | None


class UnseenRow(Row):
    """What the readings cannot tell."""

    directions: int  #: Of the unknowns, without the prior.
    without_bound: int  #: Of these, such that no prior fills.
    stiffer: Texts  #: Links and joints that may be ten times stiffer than the prior.
    softer: Texts  #: And ten times softer.
    words: Texts


class SpreadRow(Row):
    """Of the distribution in posterior.npz."""

    degrees_of_freedom: (
        Annotated[float, Field(gt=0, le=LARGEST)] | None
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
        str, Number | None
    ]  #: Of every joint; null where it is counted in that of the link before it.
    units: str  #: Of both.
    prior: PriorRow | None
    runs: RunsRow
    certificate: CertificateRow
    unseen: UnseenRow
    spread: SpreadRow
    notes: Texts
    about: AboutRow
