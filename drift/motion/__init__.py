"""What drifts, and what moves it: the ensemble, its priors, winds and currents, the clock."""
