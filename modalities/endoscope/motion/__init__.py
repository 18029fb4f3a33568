"""How the probe moved: feed, roll, centring on the bore, and the place of every frame."""
