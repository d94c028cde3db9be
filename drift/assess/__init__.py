"""Measure how good a forecast is, and compare two forecasts."""
