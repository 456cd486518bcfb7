"""The reactions of an arm without a path to its goal, each with what keeps it up, a file for each kind. They do not
know each other; `arbiter.py` ranks them.
"""
