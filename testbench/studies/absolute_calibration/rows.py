"""The table of the study of absolute calibration: a row a fit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Held:
    """Numbers that should lie in their 95 % intervals."""

    of: int
    inside: int


@dataclass(frozen=True)
class Row:
    """One fit of one campaign."""

    arm: str
    true_arm: str  #: One of TRUE_ARMS.
    campaign: str  #: One of CAMPAIGNS.
    poses: int
    readings: int
    model: str  #: One of MODELS.
    kept: tuple[str, ...]  #: Errors that cross-validation kept, where it chose.
    error_mm: float  #: RMS distance of predicted from true positions in the checking poses, own weight.
    loaded_mm: float  #: The same under the payload.
    optimum_mm: float | None  #: RMS distance that is expected when the sizes of all errors are known.
    positions: Held  #: Readings in the checking poses.
    geometry: Held | None
    joint_errors: Held | None  #: None where the model has none.
    joints: Held | None  #: Compliances of the joints.
    entries: Held | None  #: Entries of C_theta.
    #: Compliance of every joint, with the link before, found over true less one; empty of a rigid model.
    compliance_off: tuple[float, ...]
    #: RMS error of geometry along the combinations of its errors that the fit of everything knows [mm, mrad].
    geometry_off: float
    seconds: float
