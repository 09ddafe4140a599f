"""The robot corrected: a drilling pattern and a milling path, before and after, on the true elastic arm.

python scenarios/compensation.py --out runs/compensation
"""

from testbench.studies import main

if __name__ == "__main__":
    main("compensation")
