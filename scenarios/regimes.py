"""Where the cone pays by itself: GCO over least squares of the same structure, a map of noise by poses.

python scenarios/regimes.py --out runs/regimes
"""

import sys

from testbench.studies.regimes.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
