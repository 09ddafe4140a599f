"""Section 5.2: the illustrative 6R arm, full poses, LS against GCO, Tables I and II, and the order m.

python scenarios/six_dof_arm.py --out runs/six_dof_arm
"""

import sys

from testbench.studies.run import main
from testbench.studies.six_dof_arm.study import STUDY

if __name__ == "__main__":
    sys.exit(main(STUDY))
