"""Laws of joints that a plan's readings do not determine, and further readings that would."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from testbench.design.planning import Plan
from testbench.design.rows import SCALE_UNCERTAINTY, Specification, measured_rows
from testbench.errors import Array, Mask
from testbench.identify.metric import precision_root, scale_by_prior
from testbench.identify.prior import Prior, Strength
from testbench.model.laws import for_load_history, with_joint_laws, with_laws
from testbench.model.load import Load
from testbench.model.structure import all153
from testbench.workflows.plan_settings import pull_words
from testbench.workflows.predicted_error import first_digit, prior_uncertainty

OPEN_VARIANCE_SHARE = 0.5  #: Share of the variance of a law's size beyond which readings do not tell it [1].
LIGHTER = 0.4  #: Weight of a second load over the first [1].


@dataclass(frozen=True)
class OpenLaw:
    """Joints of which a law stays open, and the further reading in every pose that tells most of them."""

    kind: str  #: The law.
    joints: list[str]  #: Those of which it is open.
    by: str | None  #: The reading, in words; None where none tells any.
    told: list[str]  #: Those of which this reading tells it.
    never: list[str]  #: Those of which no reading that was examined does.


def open_laws(plan: Plan, prior: Prior) -> list[OpenLaw]:
    """Laws of which a plan's readings leave more than `OPEN_VARIANCE_SHARE` of their sizes' variance.

    Sizes are uncertain by one before, compliances as the plan has them. None where links are not all
    identified with a prior: then joints are linear.
    """
    spec, vjm = plan.specification, plan.specification.experiment.vjm
    plain = all153(vjm.arm)
    linear = spec.experiment.scaling.structure.n < plain.n or not vjm.arm.joints
    if spec.uncertainty is None or linear:
        return []
    whole = scale_by_prior(prior, with_joint_laws(vjm), with_laws(plain, vjm.arm))
    B, _ = precision_root(
        scale_by_prior(prior, vjm, plain), Strength(prior_uncertainty(spec), SCALE_UNCERTAINTY)
    )
    specification = replace(
        spec, experiment=replace(spec.experiment, vjm=with_joint_laws(vjm), scaling=whole)
    )
    M = block_diag(B.T @ B, np.eye(whole.structure.laws)) + _information(specification, plan)
    stays = _open(M, plain.n)
    tells = {
        words: stays & ~_open(M + _information(s, plan), plain.n)
        for words, s in further_readings(specification, plan).items()
    }
    kinds: dict[str, dict[str, int]] = {}
    for k in np.flatnonzero(stays).tolist():
        joint, _, kind = whole.structure.labels[whole.structure.n_compliance_rows + k].rpartition(" ")
        kinds.setdefault(kind, {})[joint] = k
    return [_open_law(kind, places, tells) for kind, places in kinds.items()]


def _open_law(kind: str, places: dict[str, int], tells: dict[str, Mask]) -> OpenLaw:
    """A law that is open of some joints, by their places among all laws, and what tells it."""
    told = {words: [joint for joint, k in places.items() if some[k]] for words, some in tells.items()}
    by = max(told, key=lambda words: len(told[words]))
    never = [joint for joint in places if not any(joint in some for some in told.values())]
    return OpenLaw(kind, list(places), by if told[by] else None, told[by], never)


def further_readings(spec: Specification, plan: Plan) -> dict[str, Specification]:
    """What may be read once more in every pose, in words, the easiest first."""
    vjm, at, every = spec.experiment.vjm, spec.experiment.vjm.load, len(spec.loads)
    back = replace(spec.experiment, vjm=for_load_history(vjm, np.ones(len(plan.q), dtype=bool)))
    lighter = tuple(Load(LIGHTER * load.wrench, load.point) for load in spec.loads)
    pulls = first_digit(float(np.linalg.norm(spec.loads[0].wrench[:3]))) * np.eye(3)
    return {
        "the same again": spec,
        "the unloaded one, after the load was taken off (`loading` off)": replace(spec, experiment=back),
        f"a second load, {LIGHTER:g} of the first": replace(spec, loads=lighter),
        **{
            f"a {pull_words(own)}": replace(spec, loads=(Load(np.append(own, np.zeros(3)), at),) * every)
            for own in pulls.tolist()
        },
    }


def _information(spec: Specification, plan: Plan) -> Array:
    """What the plan's poses tell of all unknowns, (n, n)."""
    A = measured_rows(spec, plan.q, plan.load).reshape(-1, spec.experiment.scaling.structure.n)
    return np.asarray(A.T @ A)


def _open(M: Array, plain: int) -> Mask:
    """Which laws information leaves open, those behind so many plain unknowns, (laws,)."""
    return np.asarray(np.diag(np.linalg.inv(M))[plain:] > OPEN_VARIANCE_SHARE)
