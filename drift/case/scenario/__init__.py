"""Scenarios in a case file: the object, where and when it went adrift, how it steers."""
