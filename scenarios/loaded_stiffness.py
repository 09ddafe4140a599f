"""Eq. (7) in numbers: what the linear model loses under heavy loads, and what K_w gives back.

python scenarios/loaded_stiffness.py --seed 1 --out runs/loaded_stiffness
"""

from testbench.studies import main

if __name__ == "__main__":
    main("loaded_stiffness")
