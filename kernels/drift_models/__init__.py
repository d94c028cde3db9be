"""Drift models of the package: one file each, in the form of a user's own (docs/howto/model.md).

A case names `NAME.py` of this folder as `motion = "NAME"`.
"""
