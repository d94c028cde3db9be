"""Files and addresses: opening, reading and fingerprinting.

Libraries that damaged or hostile data may crash run in separate processes.
"""
