"""Where winds and currents come from: providers, what they offer of a box and a span, and how it is
fetched.
"""
