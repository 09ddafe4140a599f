"""Estimators of anybody in frozen tasks; `testbench bench` does the same.

python scenarios/bench.py ENTRY.py --out runs/bench
"""

from testbench.studies import main

if __name__ == "__main__":
    main("bench")
