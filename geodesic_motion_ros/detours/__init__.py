"""Curves beside a path that a few obstacles block: a lattice of displacements, and a band that is drawn tight."""
