"""Many objects released by one event: simulated spills, finds, washup and origin."""
