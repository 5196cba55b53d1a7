"""The command line `msl-fem`: a thin layer over the functions of the package."""
