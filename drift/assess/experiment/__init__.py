"""Run a case many times in several variants on common random numbers: `drift experiment`."""
