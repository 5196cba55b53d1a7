"""The field of a magnet: solver, kinds of magnet, sweeps to tables, maps by root finding."""
