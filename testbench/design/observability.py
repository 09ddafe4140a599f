"""Observability indices O1 to O5 of a plan, as calibration engineers quote them.

O1: Borm and Menq (IJRR 1991). O2: Driels and Pathre (J. Robotic Systems 1990). O3: Nahvi, Hollerbach and
Hayward (ICRA 1994). O4: Nahvi and Hollerbach (ICRA 1996). O5: Sun and Hollerbach (ICRA 2008), who compare
all five.
"""

from dataclasses import dataclass

import numpy as np

from testbench.design.rows import Problem
from testbench.errors import Ids
from testbench.identify.regression import RANK_TOLERANCE


@dataclass(frozen=True)
class Observability:
    """Indices of the singular values s of the stacked whitened rows of a plan, no prior.

    The unknowns are in units of what is expected, so that s have one unit, 1; all indices are zero where the
    plan leaves a direction unseen that the candidates can show.
    """

    o1: float  #: (product of s)^(1/r) / sqrt(poses): volume.
    o2: float  #: s_min / s_max: inverse condition number.
    o3: float  #: s_min: noise amplification of the worst direction.
    o4: float  #: s_min^2 / s_max: noise amplification index.
    o5: float  #: 1 / sum(1 / s): harmonic mean over r.
    seen: int  #: Directions that the plan sees.
    of: int  #: Directions that the candidates can show.


def observability(problem: Problem, chosen: Ids) -> Observability:
    """Indices of a plan of candidates, (poses,)."""
    s = np.linalg.svd(problem.rows[chosen].reshape(-1, problem.r), compute_uv=False)
    seen = int((s > RANK_TOLERANCE * s[0]).sum())
    if seen < problem.r:
        return Observability(0.0, 0.0, 0.0, 0.0, 0.0, seen, problem.r)
    return Observability(
        o1=float(np.exp(np.log(s).mean()) / np.sqrt(len(chosen))),
        o2=float(s[-1] / s[0]),
        o3=float(s[-1]),
        o4=float(s[-1] ** 2 / s[0]),
        o5=float(1 / (1 / s).sum()),
        seen=seen,
        of=problem.r,
    )
