"""What noise costs, by method and structure, and what better instruments are worth.

python scenarios/noise_sensitivity.py --out runs/noise_sensitivity
"""

import sys

from testbench.studies.noise_sensitivity.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
