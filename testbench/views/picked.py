"""As views/scene.py has it; this name goes."""

from testbench.views.scene import evenly as evenly
from testbench.views.scene import of_all as of_all
from testbench.views.scene import picked as picked
