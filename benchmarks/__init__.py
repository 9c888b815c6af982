"""The comparison of contact solvers: `python -m benchmarks`.

One thread everywhere. The pools of BLAS, OpenMP and rayon read these variables when they are first loaded, so they are
set here, before anything imports numpy; a value set by the user stays and is recorded with the results.
"""

import os

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")

for _variable in THREAD_VARIABLES:
    os.environ.setdefault(_variable, "1")
