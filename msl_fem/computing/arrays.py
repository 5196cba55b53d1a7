"""The one array type of the package's signatures."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
