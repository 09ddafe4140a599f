"""As views/scene.py has it; this name goes."""

from testbench.views.scene import Line as Line
from testbench.views.scene import PlaceMap as PlaceMap
from testbench.views.scene import RunChart as RunChart
