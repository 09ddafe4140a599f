"""What the names of truths and priors mean, for readers."""

import numpy as np

from testbench.bench.truths import UNEQUAL
from testbench.bench.wrong_prior import FAR, SCALE, SHAPE, TURN

TRUTH_WORDS = {
    "tubes": "the folder's: every link a straight tube, which the template contains",
    **{
        f"off_{percent}": f"every link {percent} % off any tube along its axes, and these turned by "
        f"{np.rad2deg(percent / 100):.0f} degrees"
        for percent in (10, 20, 40)
    },
    "cast": "every link a cast box, tapered, bowed, beside its joints, half of them with an open side; as "
    "long as the tube and in the mean as compliant under moments",
    "joints": f"joints other than the folder's, standard deviation of the logarithm {UNEQUAL:g}",
}
PRIOR_WORDS = {
    "right": "the folder's compliances",
    "scaled": f"{SCALE:g} times too soft, and {100 * SHAPE:.0f} % off axis by axis, as all that follow",
    "link": f"one link {FAR:g} times too soft or too stiff",
    "joints": f"all joints {FAR:g} times too soft or too stiff",
    "axes": f"beam axes of every link turned by {np.rad2deg(TURN):.0f} degrees",
    "uncoupled": "no couplings inside a link",
}
