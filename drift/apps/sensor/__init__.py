"""Where a sensor of a case would hear, or see, a target: from what is asked to maps, tables and
words.
"""
