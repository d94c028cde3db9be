"""Many runs of a case, in several ways on common random numbers, and what they came to:

`drift experiment`.
"""
