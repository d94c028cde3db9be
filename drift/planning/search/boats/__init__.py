"""Where and when boats may search: seas, depths, daylight, courses."""
