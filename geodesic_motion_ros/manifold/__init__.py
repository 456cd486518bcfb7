"""The learned manifold in numpy: decoders, the graph of the latent space, metrics and shortest paths."""
