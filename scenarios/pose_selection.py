"""Poses that pay: plans by every criterion against random poses, verified by full simulation.

python scenarios/pose_selection.py --out runs/pose_selection
"""

import sys

from testbench.studies.pose_selection.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
