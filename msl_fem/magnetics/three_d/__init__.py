"""Magnets in three dimensions: nonlinear magnetostatics by the scalar potential on a graded grid of boxes."""
