"""Section 5.1: one link, six loads, least squares against GCO over a thousand draws of noise.

python scenarios/single_link.py --seed 1 --out runs/single_link
"""

import sys

from testbench.studies.run import main
from testbench.studies.single_link.study import STUDY

if __name__ == "__main__":
    sys.exit(main(STUDY))
