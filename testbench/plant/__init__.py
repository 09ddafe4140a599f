"""The truth side: MuJoCo. Shares the arm's description with the model side, and no code."""

from testbench.plant.elastic import elastic_mjcf
from testbench.plant.equilibrium import Equilibrium, Plant, build_plant, settle

__all__ = ["Equilibrium", "Plant", "build_plant", "elastic_mjcf", "settle"]
