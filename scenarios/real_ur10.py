"""A real UR10: geometry, springs, links and joint errors explain public readings, series against series.

python scenarios/real_ur10.py --out runs/real_ur10
"""

from testbench.studies import main

if __name__ == "__main__":
    main("real_ur10")
