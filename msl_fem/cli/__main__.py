"""The console script's entry: one BLAS thread a process, set before anything loads a BLAS."""

import gc
import os
import sys

# Small dense problems lose time to a BLAS's own threads; parallel work here is by processes.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

ALLOCATIONS = 10_000
"""Between two looks for cycles: at Python's 700 a command that imports a mesher spends a tenth of its time on them."""


def main() -> None:
    """Run the command line and leave with its exit status."""
    gc.set_threshold(ALLOCATIONS)
    from msl_fem.cli.app import app
    from msl_fem.cli.output import INTERRUPTED, bear_any_output, drop_unwritten, leave_interrupted, run_guarded

    bear_any_output()
    try:
        status = run_guarded(app)
    except KeyboardInterrupt:  # while the guard itself was ending
        status = INTERRUPTED
    if status == 1:
        drop_unwritten()
    if status == INTERRUPTED:
        leave_interrupted()
    sys.exit(status)


if __name__ == "__main__":
    main()
