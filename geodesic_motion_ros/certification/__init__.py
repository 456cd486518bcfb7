"""Whether a motion of an arm keeps its requirement: distances of swept spheres, declared scenes, seen volumes."""
