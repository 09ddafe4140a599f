"""What the data cannot see: the KR 500 under gravity, with and without a prior, right and wrong.

python scenarios/identifiability.py --out runs/identifiability
"""

import sys

from testbench.studies.identifiability.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
