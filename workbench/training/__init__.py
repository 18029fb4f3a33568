"""Training of the learned eye on bores of the simulator, made more varied than these."""
