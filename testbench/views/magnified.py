"""As views/scene.py has it; this name goes."""

from testbench.views.scene import arrow_scale as arrow_scale
from testbench.views.scene import round_scale as round_scale
