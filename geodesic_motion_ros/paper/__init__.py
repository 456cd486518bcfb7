"""The planner of the paper, to the letter: what everything else of this package is measured against.

H. Beik-Mohammadi, S. Hauberg, G. Arvanitidis, G. Neumann, L. Rozo, "Reactive Motion Generation on Learned Riemannian
Manifolds", IJRR 2023. A dense grid of the latent box, decoded once; edges reweighted by the ambient metric of the
obstacles; the shortest path by an exact search; a cubic spline through it by least squares, decoded. Nothing is removed
near obstacles, nothing predicted, nothing certified: it may pass through obstacles, and is for simulation only.
"""
