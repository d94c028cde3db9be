"""A contact that was lost: its track by the detections there are, its areas now, and a path on
which to regain it.
"""
