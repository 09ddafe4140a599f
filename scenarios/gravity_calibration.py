"""Section 6 in simulation: a heavy arm, 460.3 kg, three markers, LS against GCO.

python scenarios/gravity_calibration.py --seed 1 --out runs/demo
"""

import sys

from testbench.studies.gravity_calibration.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
