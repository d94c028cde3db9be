"""Winds, currents and Stokes drift: from what files say to slices on a regular grid."""
