"""As views/scene.py has it; this name goes."""

from testbench.views.scene import Layer as Layer
from testbench.views.scene import Poses as Poses
from testbench.views.scene import Scene as Scene
