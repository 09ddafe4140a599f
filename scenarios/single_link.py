"""Section 5.1: one link, six loads, least squares against GCO over a thousand draws of noise.

python scenarios/single_link.py --seed 1 --out runs/single_link
"""

from testbench.studies import main

if __name__ == "__main__":
    main("single_link")
