"""Where the cone pays by itself: GCO over least squares of the same structure, a map of noise by poses.

python scenarios/regimes.py --out runs/regimes
"""

from testbench.studies import main

if __name__ == "__main__":
    main("regimes")
