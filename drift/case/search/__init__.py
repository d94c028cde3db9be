"""Searches in a case file: sorties, sensors, looks, contacts, and units to plan for."""
