"""Solvers of Eq. (19) on the same data: the paper's search over b against a conic program with a certificate.

python scenarios/solver_comparison.py --seed 1 --out runs/solver_comparison
"""

from testbench.studies import main

if __name__ == "__main__":
    main("solver_comparison")
