"""What the model does not know: each disturbance of the true arm alone and all together, beside the noise.

python scenarios/model_error.py --out runs/model_error
"""

import sys

from testbench.studies.model_error.study import STUDY
from testbench.studies.run import main

if __name__ == "__main__":
    sys.exit(main(STUDY))
