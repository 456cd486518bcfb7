"""The reactions of an arm without a path to its goal: one proposer a file. They do not know each other; `arbiter.py`
ranks them.
"""
