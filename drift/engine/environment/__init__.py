"""The environment of a run: winds, currents and coast, opened once, and checks of their
coverage.
"""
