"""Winds, currents and Stokes drift: from files to slices on a regular grid."""
