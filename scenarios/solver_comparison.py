"""Solvers of Eq. (19) on the same data: the paper's search over b against a conic program with a certificate.

python scenarios/solver_comparison.py --seed 1 --out runs/solver_comparison
"""

import sys

from testbench.studies.run import main
from testbench.studies.solver_comparison.study import STUDY

if __name__ == "__main__":
    sys.exit(main(STUDY))
