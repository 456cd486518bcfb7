"""Success among moving spheres, beside other methods."""
