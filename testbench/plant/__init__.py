"""The truth side: MuJoCo. Shares the arm's description with the model side, and no code.

Arguments are the same everywhere: q are actuated joints, (runs, n) [rad, m]; wrench is force and moment in
world axes, (runs, 6) [N, N m]; point is where it acts, in the tool's frame, (runs, 3) [m]. What has another
shape or is not finite is a `BenchError`.
"""

import logging

import mujoco

from testbench.plant.build import Plant as Plant
from testbench.plant.build import build_plant as build_plant
from testbench.plant.build import weightless as weightless
from testbench.plant.disturbance import KR500_COMPENSATOR as KR500_COMPENSATOR
from testbench.plant.disturbance import STIFF_COMPENSATOR as STIFF_COMPENSATOR
from testbench.plant.disturbance import TYPICAL as TYPICAL
from testbench.plant.disturbance import Disturbances as Disturbances
from testbench.plant.disturbance import GeometryErrors as GeometryErrors
from testbench.plant.disturbed import disturb as disturb
from testbench.plant.elastic import elastic_mjcf as elastic_mjcf
from testbench.plant.equilibrium import Equilibrium as Equilibrium
from testbench.plant.equilibrium import settle as settle
from testbench.plant.equilibrium import settle_linear as settle_linear
from testbench.plant.equilibrium import settle_pair as settle_pair
from testbench.plant.equilibrium import unloaded as unloaded
from testbench.plant.gear import GearErrors as GearErrors
from testbench.plant.gear import Gears as Gears
from testbench.plant.site import Contact as Contact
from testbench.plant.site import Kind as Kind
from testbench.plant.site import Payload as Payload
from testbench.plant.site import Site as Site
from testbench.plant.site import build_site as build_site
from testbench.plant.site import check_poses as check_poses
from testbench.plant.site import collisions as collisions
from testbench.plant.site import contacts as contacts
from testbench.plant.site import has_surroundings as has_surroundings
from testbench.plant.site import hidden as hidden

log = logging.getLogger(__name__)
log.addHandler(logging.NullHandler())  # a problem is one line on standard error; who listens hears this too
mujoco.set_mju_user_warning(log.warning)  # else to MUJOCO_LOG.TXT where one stands
