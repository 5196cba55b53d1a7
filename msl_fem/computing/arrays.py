"""The array types of the package's signatures."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Slopes = NDArray[np.float32]
"""Of a residual, many millions at once, in single precision: of a part that others make up for a million times larger
than what is left, rounding adds a thousandth of what is left; a few thousand times are seen in records."""
