"""How the catheter turned: uneven turns, and the angles at which turns start."""
