"""Input files of `drift track`, of tracking experiments and of `drift bridge`."""
