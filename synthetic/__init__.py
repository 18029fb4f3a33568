"""A renderer of bores, air cells and the recordings that both instruments make of them, with truth."""
