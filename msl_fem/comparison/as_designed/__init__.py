"""What the drawing tells of a plant beside its table: mutual inductance, end effects, leaves, sheets, heat, film.

Everything comes with its source and one sigma, which is the prior of what follows: a `plant.believed.Belief`.
"""

from msl_fem.comparison.as_designed.drawing import as_designed

__all__ = ["as_designed"]
