"""How things are computed: compiled functions, lanes, Gauss-Newton, linear models, BLAS threads."""
