"""The driver of a real arm, measured on a simulated one behind its protocol."""
