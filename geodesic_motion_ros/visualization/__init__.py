"""Pictures of skills, motions and the latent space."""
