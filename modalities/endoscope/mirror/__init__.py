"""The mirror in the image: its ring, its optics, and the band of wall it shows."""
