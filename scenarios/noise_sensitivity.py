"""What noise costs, by method and structure, and what better instruments are worth.

python scenarios/noise_sensitivity.py --out runs/noise_sensitivity
"""

from testbench.studies import main

if __name__ == "__main__":
    main("noise_sensitivity")
