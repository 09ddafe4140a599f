"""Models by name: a structure with the method that identifies it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from string import digits

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset
from testbench.display import Displayed
from testbench.errors import BenchError
from testbench.identify import Estimate, Estimator, Method, completed_least_squares, gco, least_squares
from testbench.identify.estimate import make_estimate
from testbench.identify.fold import reduce
from testbench.identify.regression import non_redundant
from testbench.model.structure import (
    FULL,
    TEMPLATE,
    Structure,
    all153,
    joints_only,
    mgco47,
    mgco68,
    mgco69,
    mgco147,
    template56,
)
from testbench.model.structure import JOINTS as JOINTS
from testbench.model.vjm import Vjm
from testbench.workflows.cell import Cell
from testbench.workflows.rows import FAILED, FitRow

WITHOUT_CONE = "LS153"  #: All links and joints by least squares: what the default is without its cone.
EQUAL_FIT = "MLS56, PSD of equal fit"


@dataclass(frozen=True, repr=False)
class Model(Displayed):
    """Hold a named structure with the method that identifies it."""

    name: str  #: Name as in the paper, such as MGCO68.
    structure: Structure  #: The unknowns.
    estimator: Estimator  #: A `Method`, or a function of your own.

    @property
    def filled(self) -> bool:
        """Tell whether its method, or a user's estimator, has a prior."""
        return getattr(self.estimator, "prior", None) is not None

    def about(self) -> dict[str, object]:
        """Summarise name and number of unknowns."""
        return {"name": self.name, "unknowns": self.structure.n}


def _made(structure: Callable[[Arm], Structure], estimator: Estimator) -> Callable[[Cell], Model]:
    def make(cell: Cell) -> Model:
        unknowns = structure(cell.arm)
        return Model(unknowns.name, unknowns, estimator)

    return make


class _Named(dict[str, Callable[[Cell], Model]]):
    """Models by name; a BenchError lists the names where there is no such model."""

    def __missing__(self, name: str) -> Callable[[Cell], Model]:
        raise BenchError(f"expected a model of {', '.join(self)}, got {name!r}")

    def __repr__(self) -> str:
        return f"models {', '.join(self)}"


MODELS = _Named(
    {
        JOINTS: _made(joints_only, least_squares),
        "MLS32": lambda cell: Model(
            "MLS32", non_redundant(cell.vjm, template56(cell.arm), name="MLS32"), least_squares
        ),
        "MLS56": _made(partial(template56, name="MLS56"), least_squares),
        "MGCO47": _made(mgco47, gco),
        "MGCO56": _made(template56, gco),
        "MGCO68": _made(mgco68, gco),
        "MGCO69": _made(mgco69, gco),
        "MGCO147": _made(mgco147, gco),
        "ALL153": _made(all153, gco),
    }
)
"""Models by name, the paper's, "Joints" and "ALL153": MODELS["MGCO56"](cell) has structure and method.

The names count the unknowns of an arm of six joints; of another arm they are kinds, and the model's own name
has its own count.
"""

SECTION_6 = ("MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""The models of section 6, in the paper's order."""
PAPERS_JOINTS = 6  #: Joints of the arms for which the paper chose links and parameters.
ANY_ARM = (JOINTS, "MLS56", "MGCO56", "MGCO147", "ALL153")
"""Kinds of models that take all links or none, and so are of any arm."""
LEVEL = 1e-9  #: Of a direction's upward part: rounding.
ALL_UNKNOWNS = "ALL"  #: Of any arm the model of all links and joints, whatever its count.


def arm_model_names(arm: Arm) -> dict[str, str]:
    """Map the names of an arm's models to their kinds, keys of `MODELS`."""
    if arm.n_joints == PAPERS_JOINTS:
        return {name: name for name in MODELS}
    full, single = len(FULL) * len(arm.links), len(TEMPLATE) * len(arm.links)
    counts = ("", single, single, full, full + arm.n_joints)
    names = (f"{kind.rstrip(digits)}{count}" for kind, count in zip(ANY_ARM, counts, strict=True))
    found = dict(zip(names, ANY_ARM, strict=True))
    return found if arm.joints else {name: kind for name, kind in found.items() if kind != JOINTS}


def arm_model_name(cell: Cell, kind: str) -> str | None:
    """Return the name of an arm's model of a kind.

    MGCO68 leaves out joint 1 because gravity does not load it. If gravity does, MGCO69 replaces it.

    Args:
        cell: The arm.
        kind: Key of `MODELS`.

    Returns:
        The name; None if the arm has no such model.
    """
    kind = "MGCO69" if kind == "MGCO68" and _first_is_loaded(cell.vjm) else kind
    return next((name for name, own in arm_model_names(cell.arm).items() if own == kind), None)


def plain_name(cell: Cell) -> str:
    """Return the default model for a fit without a prior."""
    found = arm_model_name(cell, "MGCO68") or arm_model_name(cell, "MGCO56")
    assert found  # of any arm
    return found


def _first_is_loaded(vjm: Vjm) -> bool:
    """Whether gravity moves joint 1: a hinge that is not upright, a slide that is not level."""
    if not vjm.arm.joints:
        return False
    upward = abs(float(vjm.base[2, :3] @ vjm.placements[0, :3, :3] @ vjm.axes[0]))
    return upward > LEVEL if vjm.arm.joints[0].prismatic else upward < 1 - LEVEL


def named_models(cell: Cell, names: Sequence[str] = SECTION_6) -> list[Model]:
    """Build models by the names that the arm gives them.

    Args:
        cell: The arm.
        names: Names in any case; "ALL" for all links and joints.

    Returns:
        The models.

    Raises:
        BenchError: If the arm has no such model.
    """
    return [MODELS[arm_model_names(cell.arm)[canonical_name(cell.arm, name)]](cell) for name in names]


def canonical_name(arm: Arm, name: str) -> str:
    """Find the exact name of an arm's model.

    Args:
        arm: The arm.
        name: The name in any case.

    Returns:
        The name.

    Raises:
        BenchError: If the arm has no such model.
    """
    names = arm_model_names(arm)
    every = {known.casefold(): known for known in names}
    every |= {ALL_UNKNOWNS.casefold(): next(known for known, kind in names.items() if kind == "ALL153")}
    if name.casefold() in every:
        return every[name.casefold()]
    of = "" if arm.n_joints == PAPERS_JOINTS else f" of {arm.name}, {arm.n_joints} joints"
    raise BenchError(f"no model {name!r}{of}; models are {', '.join(names)}")


def equal_fit(cell: Cell) -> Model:
    """Make the model of MLS56 with its free directions used to be conservative."""
    return Model(EQUAL_FIT, template56(cell.arm, name="MLS56"), completed_least_squares)


class EstimatorFailed(BenchError):
    """Signal that a user's estimator failed, or that its answer is none."""

    def __init__(self, model: Model, why: str) -> None:
        super().__init__(f"{model.name}: its estimator failed: {why}")
        self.model, self.why = model, why


def fit_model(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """Fit a model to runs; a user's estimator does not see the folder's compliances.

    Args:
        cell: The arm with its model and its truth.
        model: The model.
        data: Measured runs.

    Returns:
        The estimate.
    """
    if isinstance(model.estimator, Method):
        return model.estimator(cell.vjm, model.structure, data)
    try:
        estimate = model.estimator(without_compliances(cell.vjm), model.structure, data)
    except Exception as err:
        why = str(err) if isinstance(err, BenchError) else f"{type(err).__name__}: {err}"
        raise EstimatorFailed(model, " ".join(why.split())) from err
    if not isinstance(estimate, Estimate):
        raise EstimatorFailed(model, f"expected an Estimate, got {type(estimate).__name__}")
    n = model.structure.n
    if estimate.pi.shape != (n,) or not (
        np.isfinite(estimate.pi).all() and np.isfinite(estimate.C_theta).all()
    ):
        raise EstimatorFailed(model, f"expected {n} finite parameters, got shape {estimate.pi.shape}")
    return estimate


def fit_or_rigid(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """Fit a model to runs; of an estimator that fails return a rigid arm, whose status says why.

    Args:
        cell: The arm with its model and its truth.
        model: The model.
        data: Measured runs.

    Returns:
        The estimate; see `has_failed`.
    """
    try:
        return fit_model(cell, model, data)
    except EstimatorFailed as err:
        regression = reduce(cell.vjm, model.structure, data)
        rigid = make_estimate(regression, np.zeros(model.structure.n), method="own estimator")
        return replace(rigid, status=FAILED + err.why)


def has_failed(estimate: Estimate) -> bool:
    """Tell whether an estimate is of a user's estimator that failed: its numbers say nothing."""
    return estimate.status.startswith(FAILED)


def without_compliances(vjm: Vjm) -> Vjm:
    """Replace an arm's compliances by NaN: in simulations the folder's may be the true ones."""
    links = tuple(replace(link, compliance=np.full((6, 6), np.nan)) for link in vjm.arm.links)
    joints = tuple(replace(joint, compliance=np.nan) for joint in vjm.arm.joints)
    return replace(vjm, arm=replace(vjm.arm, links=links, joints=joints))


def failed_row(err: EstimatorFailed) -> FitRow:
    """Make the row of an estimator that failed."""
    name, structure, status = err.model.name, err.model.structure, FAILED + err.why
    return FitRow(
        name=name, structure=structure.name, prior=err.model.filled, status=status, parameters=structure.n
    )
