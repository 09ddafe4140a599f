"""Which method to use by default: a family of true arms, wrong priors, 8, 12 and 20 poses.

python scenarios/which_model.py --out runs/which_model
"""

import sys

from testbench.studies.run import main
from testbench.studies.which_model.study import STUDY

if __name__ == "__main__":
    sys.exit(main(STUDY))
