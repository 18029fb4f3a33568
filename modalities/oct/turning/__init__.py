"""How the catheter turned: start angles, uneven turns, the sheath."""
