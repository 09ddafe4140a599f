"""Eq. (7) in numbers: what the linear model loses under heavy loads, and what K_w gives back.

python scenarios/loaded_stiffness.py --seed 1 --out runs/loaded_stiffness
"""

import sys

from testbench.studies.loaded_stiffness.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
