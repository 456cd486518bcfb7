"""Compiled kernels: what compiles them ahead, and what loads them before a stream."""
