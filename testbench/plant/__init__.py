"""The simulated true arm, in MuJoCo. It shares the arm's description with the model, but no code.

Arguments are the same everywhere: q are actuated joints, (runs, n) [rad, m]; wrench is force and moment in
world axes, (runs, 6) [N, N m]; point is where it acts, in the tool's frame, (runs, 3) [m]. Another
shape, or a number that is not finite, is a `BenchError`.
"""

import logging

import mujoco

log = logging.getLogger(__name__)
log.addHandler(logging.NullHandler())  # a problem is one line on standard error; who listens hears this too
mujoco.set_mju_user_warning(log.warning)  # else to MUJOCO_LOG.TXT where one stands
