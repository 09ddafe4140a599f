"""What the readings of a calibration leave open, and what hides behind what: in words."""

from dataclasses import replace

import numpy as np

from testbench.errors import Array
from testbench.identify.absolute.evidence import LOOSE, Choice
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.pull import pull_of
from testbench.identify.absolute.seen import hidden
from testbench.identify.absolute.seen_words import sentences
from testbench.identify.absolute.unknowns import Unknowns
from testbench.model.joint_errors import JointErrors
from testbench.model.structure import Ids

LOOSE_FRAME = 0.01  #: Standard deviation of frames and mounts beforehand [m, rad].
ORDERS = 4  #: Periodic errors that are spoken of: higher ones look like nothing else.


def left_open(found: Calibration) -> tuple[str, ...]:
    """Sentences on geometry, compliances and slow joint errors; the other errors count as known."""
    own, unknowns = found.own, found.own.unknowns
    few, columns = _slow(own)
    deviation = np.zeros(unknowns.size)
    deviation[own.columns[: own.rigid]] = found.chosen.learnt.deviation[own.columns[: own.rigid]]
    prior = _covariance(own, deviation, columns)
    information = found.information[np.ix_(columns, columns)]
    state = replace(found.state, errors=few.errors, n=np.zeros((len(found.state.n), few.errors.size)))
    pull = pull_of(few, state, found.series)
    return sentences(hidden(few, information, prior, pull))


def _slow(own: Choice) -> tuple[Unknowns, Ids]:
    """The unknowns without periodic errors of higher orders, and where they stand among all."""
    unknowns, errors = own.unknowns, own.unknowns.errors
    few = JointErrors(errors.orders[:ORDERS], errors.ratio, errors.play, errors.stiffening)
    k, m = len(errors.orders), len(few.orders)
    of = np.r_[np.arange(m), k + np.arange(m), np.arange(2 * k, errors.size)]
    at = unknowns.starts["errors"] + errors.size * np.arange(unknowns.vjm.arm.n_joints)[:, None] + of
    before, after = np.arange(unknowns.starts["errors"]), np.arange(unknowns.starts["elastic"], unknowns.size)
    structure = unknowns.structure
    if own.elastic is not None:
        structure, after = own.elastic.structure, own.columns[own.rigid :]
    return replace(unknowns, errors=few, structure=structure), np.concatenate([before, at.ravel(), after])


def _covariance(own: Choice, deviation: Array, columns: Ids) -> Array:
    """Of the prior of these columns; frames and mounts are loose, what is off is zero."""
    loose = np.where(np.isinf(deviation), LOOSE_FRAME, deviation)[columns]
    prior = np.diag(loose**2)
    if own.elastic is not None:
        L = LOOSE.uncertainty * own.elastic.L
        prior[-len(L) :, -len(L) :] = L @ L.T
    return np.asarray(prior)
