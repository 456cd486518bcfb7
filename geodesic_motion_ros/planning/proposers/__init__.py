"""What an arm without a path to its goal may do: one proposer a file. They do not know each other; `arbiter.py` ranks
them.
"""
