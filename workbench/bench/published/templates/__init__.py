"""Templates: the board, and the texts that go with a set."""
