"""`drift track`: follow a target after its last detection; its track, areas, and a path to regain
contact.
"""
