"""Arrays in, results out: orientation series, cycles, the drift score and its trust."""
