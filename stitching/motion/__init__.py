"""Feed and roll between strips: textures, matching, and the chain of all pairs."""
