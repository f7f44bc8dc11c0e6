"""Pure compiled functions of floats and 1-D float64 arrays: no I/O, no random numbers, no checks of input."""
