"""What a search says of all that is not position: speeds, courses, times, destinations, before and
after each update.
"""
