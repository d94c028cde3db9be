"""Files and addresses: opening, reading and fingerprinting them.

Where bytes may crash a library, they are read in a process of their own.
"""
