"""What the data cannot see: the KR 500 under gravity, with and without a prior, right and wrong.

python scenarios/identifiability.py --out runs/identifiability
"""

from testbench.studies import main

if __name__ == "__main__":
    main("identifiability")
