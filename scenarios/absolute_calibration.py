"""What absolute readings tell of an arm: which errors hide behind which, how many poses, what a mix gains.

python scenarios/absolute_calibration.py --out runs/absolute_calibration
"""

from testbench.studies import main

if __name__ == "__main__":
    main("absolute_calibration")
