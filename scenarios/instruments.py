"""What dial gauges, wires, a ballbar and a camera are worth beside a laser tracker.

python scenarios/instruments.py --out runs/instruments
"""

from testbench.studies import main

if __name__ == "__main__":
    main("instruments")
