"""The desk:

`drift serve`, a page in the browser on which cases are written, run and their reports opened.
"""
