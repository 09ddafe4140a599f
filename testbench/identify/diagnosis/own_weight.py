"""Direction of an arm's own weight, by absolute readings: a base that stands otherwise than in its folder.

Under gravity from the wrong side joint springs that fit would have to be negative; held at zero they explain
none of the sag. Turned the right way they do, and the readings scatter less about the arm. A few directions
are tried: that of a level tracker, a ceiling, four walls, and the tilt at which the scatter is least.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain as joined

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError, InputError
from testbench.identify.absolute.align import align_all
from testbench.identify.absolute.fit import Calibration, first_fit
from testbench.identify.absolute.state import ArmState, nominal_state, torque_scale
from testbench.identify.diagnosis.gravity import (
    DOWN,
    LEVEL,
    Pull,
    angle,
    mean_level,
    mounted,
    mounting,
    snapped,
    towards,
)
from testbench.identify.diagnosis.hypothesis import Issue
from testbench.identify.diagnosis.kinematics import FreeParameters, Observations, fit
from testbench.identify.metric import scale_by_prior
from testbench.identify.prior import Prior
from testbench.model.load import own_weight, read_weights
from testbench.model.loaded import displacement
from testbench.model.structure import joints_only
from testbench.model.vjm import chain

ROWS = 150  #: Rows of a series, evenly out of more, that are fitted.
STUCK = (
    0.05  #: Compliance over the folder's below which a joint that carries weight would rather be negative.
)
CARRIES = 0.05  #: Typical torque of a joint over the largest from which it carries weight.
FAR = 5e-3  #: Scatter, over the reach, above which more than the mounting is wrong [1].
SURE, FITTING_SHARE = 8.0, 0.8
"""Log-likelihood from which an arm hangs [nats]; share of the readings, the nearest, that count [1]."""
PROBE = np.deg2rad(15.0)  #: Tilt at which the scatter is probed for where it is least [rad].
CLEAR, LEVELLED = 20.0, 7.0
"""Log-likelihood that a mounting has to gain, and the same where a level tracker agrees [nats]."""
LESS = 0.9  #: Ratio of scatter to that with the folder's mounting, above which no mounting is reported [1].


def by_own_weight(calibration: Calibration, prior: Prior) -> Issue | None:
    """Find a base mounting under which gravity explains absolute readings much better.

    With scatter s of the readings in n poses, a mounting gains 3 n log(s_folder / s_mounting) nats.

    Args:
        calibration: The calibration with the mounting of the arm's folder.
        prior: Prior of the compliances, from the folder.

    Returns:
        The mounting; None when the one of the folder explains the readings as well, or when they scatter too
        much to tell.
    """
    state = calibration.state
    level = mean_level(state.frames.values())
    turned = level is not None and angle(level, DOWN) > LEVEL
    if not turned and not _stuck(state):
        return None
    # How well gravity along -z explains the readings.
    series = [_thin(one) for one in calibration.series]
    poses = sum(len(np.unique(one.pose)) for one in series)
    own = _scatter(state, series, prior, DOWN)
    if own > FAR * state.vjm.reach:
        return None
    # Other directions: first the one in which trackers stand level, then walls, ceiling and tilts.
    first = [snapped(level, LEVEL)] if level is not None and turned else []
    others = joined((*np.eye(3), *-np.eye(3)[:2]), _tilts(state, series, prior, own)) if _stuck(state) else ()
    for directions, least in ((first, LEVELLED), (others, CLEAR)):
        tried = [(_scatter(state, series, prior, g), g) for g in directions]
        scatter, g = min(tried, key=lambda one: one[0], default=(np.inf, DOWN))
        nats = 3 * poses * float(np.log(own / scatter)) if np.isfinite(scatter) else 0.0
        if scatter < LESS * own and nats > least:
            return mounting(state.vjm, Pull(g, level), nats)
    return None


def _stuck(state: ArmState) -> bool:
    """Tell whether springs of joints that carry weight are held at zero."""
    own, joints = np.diag(state.C_theta)[state.vjm.joint_slice], state.vjm.arm.joints
    folder = np.array([joint.compliance for joint in joints])
    carries = state.torque_scale > CARRIES * state.torque_scale.max(initial=0)
    return bool((carries & (own < STUCK * folder)).any())


def _thin(series: Series) -> Series:
    some = np.linspace(0, series.rows - 1, min(ROWS, series.rows)).astype(int)
    return select_rows(series, some)


def _scatter(state: ArmState, series: Sequence[Series], prior: Prior, g: Array) -> float:
    """Measure the scatter of readings about the arm with gravity along g, (3,) [m]; infinite if none fits."""
    vjm, every = mounted(state.vjm, g), tuple(series)
    bare = nominal_state(vjm, state.weights, torque_scale(vjm, state.weights, every))
    try:
        noise = first_fit(align_all(bare, every), every, scale_by_prior(prior, vjm, joints_only(vjm.arm)))[1]
    except BenchError:
        return float("inf")
    return float(np.hypot(noise.open_position, np.mean([one.sigma for one in series]) * noise.factor[0]))


def _tilts(state: ArmState, series: Sequence[Series], prior: Prior, own: float) -> Iterator[Array]:
    """The tilt at which the variance would be least, by a parabola through probes about both level axes."""
    slope, bend = np.zeros(2), np.zeros(2)
    for k in range(2):
        low, high = (_scatter(state, series, prior, _tilted(s * PROBE * np.eye(2)[k])) for s in (-1, 1))
        slope[k], bend[k] = (high**2 - low**2) / 2, (high**2 + low**2) / 2 - own**2
    if np.isfinite(slope).all() and (bend > 0).all():
        yield _tilted(-PROBE * slope / (2 * bend))


def _tilted(by: Array) -> Array:
    """Gravity of a base tilted by angles along its x and y, (2,) [rad]."""
    size = float(np.linalg.norm(by))
    return np.array([*(np.sin(size) * by / max(size, 1e-12)), -np.cos(size)])


def hangs(before: Observations, after: Observations, C_theta: Array) -> bool:
    """Tell whether the unloaded readings sag as those of a hanging arm, not as those of an upright one.

    Call it when targets move against stated weights. Three mistakes do that: the arm hangs, readings before
    and after are exchanged, or the force has the other sign. With RMS distances s of the
    nearest FITTING_SHARE of the readings in n poses, hanging gains 3 n log(s_upright / s_hanging) nats;
    s_upright is the smaller one of both readings.

    Args:
        before: Unloaded readings, as in the file.
        after: Loaded readings.
        C_theta: Expected compliances, scaled to the readings, (n_theta, n_theta) [m/N, rad/(N m)].

    Returns:
        Whether hanging gains more than SURE nats; False when the folder has no masses.
    """
    vjm = before.vjm
    try:
        weights = read_weights(vjm.arm)
    except InputError:  # nobody knows what it weighs
        return False
    left = []
    for observations, g in ((before, -DOWN), (after, DOWN), (before, DOWN)):
        turned = mounted(vjm, g)
        where = chain(turned, observations.q)
        theta = (C_theta @ own_weight(where, weights)).T
        sag = displacement(where, theta, observations.markers) @ towards(g).T
        bare = replace(
            observations, read=observations.read - sag, free=FreeParameters(frame=True, targets=True)
        )
        off = np.sort(fit(bare).away(observations))
        left.append(float(np.sqrt(np.square(off[: int(np.ceil(FITTING_SHARE * len(off)))]).mean())))
    hung, *upright = left
    poses = len(np.unique(before.q, axis=0))  # all that is read in one shares its errors of geometry
    return 3 * poses * float(np.log(min(upright) / max(hung, 1e-12))) > SURE
