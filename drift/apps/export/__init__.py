"""`drift export`: finished results as files for Google Earth, chart plotters, ECDIS and GIS."""
