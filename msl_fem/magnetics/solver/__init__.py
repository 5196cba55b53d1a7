"""The plane and axisymmetric nonlinear field solver; knows no magnet."""
