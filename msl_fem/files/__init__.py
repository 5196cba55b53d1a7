"""What is read and written: quantities with units, TOML, NetCDF, whole files, locks."""
