"""Parts whose hulls touch in most poses: no arm is built so, the hull is larger than the part."""

from collections import Counter
from pathlib import Path

import mujoco
import numpy as np

from testbench.errors import BenchError
from testbench.plant.build import REFUSED, check_geoms
from testbench.plant.feasible import collide
from testbench.plant.import_robot.chain import Chain
from testbench.plant.import_robot.write import Rigid

POSES = 300
MOST = 0.5  #: Share of random poses in which two parts of a sound arm touch at most [1].


def always_touching(chain: Chain, rigid: Rigid) -> tuple[tuple[str, str], ...]:
    """Pairs of parts that touch in more than half of all poses.

    Raises:
        BenchError: When MuJoCo refuses the arm.
    """
    try:
        model = mujoco.MjModel.from_xml_string(rigid.xml, rigid.meshes)
    except REFUSED as err:
        raise BenchError(f"{chain.name}: " + " ".join(f"MuJoCo refuses the arm: {err}".split())) from err
    file = Path(chain.name)
    check_geoms(file, model)
    data, seen = mujoco.MjData(model), Counter[tuple[str, str]]()
    joints = [part.joint for part in chain.parts if part.joint]
    lower, upper = np.array([j.lower for j in joints]), np.array([j.upper for j in joints])
    for q in np.random.default_rng(0).uniform(lower, upper, (POSES, len(joints))):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        collide(file, model, data)
        pairs = model.geom_bodyid[data.contact.geom[data.contact.dist < 0]]
        seen.update({(model.body(int(a)).name, model.body(int(b)).name) for a, b in np.sort(pairs, axis=1)})
    return tuple(sorted(pair for pair, count in seen.items() if count > MOST * POSES))
