"""Cone-mirror endoscopy: frames of an annulus, unrolled into the texture of the bore wall."""
